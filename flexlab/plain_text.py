"""Text from files and visitors as people may see it: every control character visible, none obeyed by a terminal or page."""

import re

REPLACEMENT = "\N{REPLACEMENT CHARACTER}"
CONTROL_PICTURES = 0x2400
"""Unicode's pictures of the 32 control characters follow one another from here: escape is ␛."""
DELETE, DELETE_PICTURE = 0x7F, 0x2421

_PICTURES = {code: CONTROL_PICTURES + code for code in range(0x20) if chr(code) not in "\t\n"} | {
    DELETE: DELETE_PICTURE
}
# Controls of the second kind, changes of the writing direction and lone surrogates have no pictures.
_WITHOUT_PICTURE = re.compile("[\x80-\x9f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")

_BEFORE_UNIT = re.compile(r"(?<=\d) (?=(?:[kmµ]?m|[km]?s|k?Hz|[km]?N|N·m|mrad|rad|kg|micrometres|MB/min|%)\b|%)")


def with_units(text: str) -> str:
    """`text` in which no line ends between a number and its unit."""
    return _BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", text)


def visible(text: object, longest: int | None = None) -> str:
    """`text` with control characters as pictures, fit for UTF-8; cut with "…" to `longest` characters if given.

    Line breaks and tabs stay.
    """
    words = str(text)
    if longest is not None and len(words) > longest:
        words = words[: longest - 1] + "…"
    return _WITHOUT_PICTURE.sub(REPLACEMENT, words.translate(_PICTURES))
