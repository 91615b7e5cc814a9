"""Text for the page: escaped, with real minus signs and units."""

import html

from flexlab.text import number_text as number

__all__ = ["escaped", "factor", "number"]

from flexlab.text import visible

LONGEST_TEXT = 2000
"""Characters of somebody else's text that the page shows at most."""


def escaped(text: str) -> str:
    """Text as it may stand in HTML; what files and people wrote is never shown without this."""
    short = text if len(text) <= LONGEST_TEXT else text[:LONGEST_TEXT] + " …"
    return html.escape(visible(short)).replace("\n", "<br>")


def factor(speed: float) -> str:
    """A speed as people say it: "1/64 ×", "1 ×", "4 ×"."""
    return f"1/{round(1 / speed)} ×" if speed < 1 else f"{number(speed)} ×"
