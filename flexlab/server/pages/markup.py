"""HTML in which every inserted text is escaped, unless it was made here itself."""

import html
from collections.abc import Iterable


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def fill(template: str, **values: object) -> Markup:
    """Put values into a template's `{names}`; escaped, but for `Markup`."""
    return Markup(template.format(**{name: _safe(value) for name, value in values.items()}))


def join(parts: Iterable[Markup]) -> Markup:
    """Pieces one after another."""
    return Markup("\n".join(_safe(part) for part in parts))


def _safe(value: object) -> str:
    return value if isinstance(value, Markup) else html.escape(str(value), quote=True)
