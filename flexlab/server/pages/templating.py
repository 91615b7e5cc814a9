"""The pages' templates, in which every inserted text is escaped, unless it was made by a template itself."""

import html
from contextvars import ContextVar
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from flexlab.plain_text import visible, with_units
from flexlab.recording.store.run_index import duration_text, size_text, state_word

HAS_CLASS = ContextVar("HAS_CLASS", default=False)
"""Whether the page is for somebody who has a class to look after: set for each request, before any page is made."""
TEMPLATES = Path(__file__).parent / "templates"


def _escaped(value: object) -> object:
    """A value as it is inserted, without what changes how others read."""
    if hasattr(value, "__html__"):
        return value
    return Markup(html.escape(visible(value), quote=True))


_environment = Environment(
    loader=FileSystemLoader(TEMPLATES),
    autoescape=True,
    # Before the automatic one, which is the net below it: the same spelling of quotes as Python's own.
    finalize=_escaped,
    # A name that is misspelt in a template is an error, not an empty place.
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    auto_reload=False,
)
_environment.globals.update(  # pyright: ignore[reportUnknownMemberType]
    duration_text=duration_text,
    size_text=size_text,
    state_word=state_word,
    with_units=with_units,
    has_class=HAS_CLASS.get,
)


def render(template: str, **values: object) -> Markup:
    """A template of `TEMPLATES` with its values filled in. Raises `jinja2.UndefinedError` for one that is missing."""
    return Markup(_environment.get_template(template).render(values))


def button(address: str, words: str) -> Markup:
    """A link that looks like a button."""
    return Markup('<a class="button" href="{}">{}</a>').format(address, words)
