"""The pages' templates. Every inserted text is escaped, unless a template made it.

Each language has a catalogue, `web_assets/languages/CODE.json`, which maps English texts to its own. There `{name}` stands
for any part of a sentence, and markdown marks for bold text, code and links. The entry `English` is the language's own name.
Pages translate themselves in the browser (`static/language.js`), because all visitors of a shared lab get the same panel.
"""

import html
import json
from collections.abc import Sequence
from contextvars import ContextVar
from decimal import Decimal
from functools import cache
from pathlib import Path

from aiohttp import web
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from flexlab.assets import web_assets_folder
from flexlab.recording.store.run_index import duration_text, size_text, state_word
from flexlab.text import number_text, plain, visible, with_units


@cache
def catalogues() -> dict[str, Path]:
    """Language code, as in `<html lang>` → file."""
    return {file.stem: file for file in sorted((web_assets_folder() / "languages").glob("*.json"))}


def read_catalogue(file: Path) -> dict[str, str]:
    """Read a catalogue: English text → translated text."""
    return json.loads(file.read_text(encoding="utf-8"))


@cache
def language_script() -> Markup:
    """The script element that shows a page in the reader's language."""
    names = {code: read_catalogue(file).get("English", code) for code, file in catalogues().items()}
    return Markup('<script src="/static/language.js" data-languages="{}"></script>').format(
        json.dumps(names, ensure_ascii=False)
    )


HAS_CLASS = ContextVar("HAS_CLASS", default=False)
"""Whether the page is for the teacher of a class; set for each request before any page is made."""
OF_HUB = ContextVar("OF_HUB", default=False)
"""Whether the page belongs to a hub's service, which has no labs or runs of its own."""
TEMPLATES = Path(__file__).parent / "templates"


def _escaped(value: object) -> object:
    """A value as it is inserted, without characters that change how the text around them reads."""
    if hasattr(value, "__html__"):
        return value
    return Markup(html.escape(visible(value), quote=True))


def _typed(value: float) -> str:
    """A number as a person would type it into a form."""
    return plain(Decimal(f"{value:.6g}"))


_environment = Environment(
    loader=FileSystemLoader(TEMPLATES),
    autoescape=True,
    # Runs before the automatic escaping, which remains as a safety net; spells quotes as Python does.
    finalize=_escaped,
    # A misspelt name in a template is an error, not an empty text.
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
    auto_reload=False,
)
_environment.globals.update(  # pyright: ignore[reportUnknownMemberType]
    duration_text=duration_text,
    number_text=number_text,
    typed=_typed,
    size_text=size_text,
    state_word=state_word,
    with_units=with_units,
    has_class=HAS_CLASS.get,
    of_hub=OF_HUB.get,
    language_script=language_script,
)


def render(template: str, **values: object) -> Markup:
    """Fill a template of `TEMPLATES` with values. Raises `jinja2.UndefinedError` for a missing value."""
    return Markup(_environment.get_template(template).render(values))


def part(macro: str, *values: object) -> Markup:
    """Fill a macro of `parts.html` with values."""
    return Markup(getattr(_environment.get_template("parts.html").module, macro)(*values))


def button(address: str, words: str) -> Markup:
    """A link that looks like a button."""
    return Markup('<a class="button" href="{}">{}</a>').format(address, words)


ALL_RUNS = button("/runs", "All runs")
PAGE_POLICY = (
    "default-src 'none'; style-src 'self'; script-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "frame-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'self'"
)
"""The server's own pages load from this address only and run no inline scripts."""
DRAWING_POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'self'"
"""Drawings, and the files that pages load, load nothing themselves."""


def page(
    template: str,
    title: str,
    *,
    here: str = "",
    kind: str = "text",
    scripts: Sequence[str] = (),
    status: int = 200,
    **values: object,
) -> web.Response:
    """A page of the server. `here`: address of the highlighted link; `kind`: class of the body; `scripts`: names in static/."""
    text = render(template, title=title, here=here, kind=kind, scripts=scripts, **values)
    headers = {"Content-Security-Policy": PAGE_POLICY, "Cache-Control": "no-store"}
    return web.Response(text=text, content_type="text/html", status=status, headers=headers)


def message(title: str, sentence: str, status: int, more: Markup | None = None) -> web.Response:
    """A page that says what happened and what to do. `more`: buttons."""
    more = more or button("/", "Start page")
    return page("message.html", title, sentence=sentence, more=more, status=status)
