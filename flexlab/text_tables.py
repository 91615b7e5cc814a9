"""Tables in text files as other programs write them: separators, decimal commas, remarks, names of columns in a remark."""

import csv
import re
from collections.abc import Iterable, Iterator

SEPARATORS = ";\t,"
"""Characters that separate columns; without them spaces do."""
REMARK, OF_EXCEL = "#", "sep="
"""Beginnings of lines that are no rows; the second tells Excel the separator."""
_NUMBERS = re.compile(r"[-+−\d.,;eE\s]*\d[-+−\d.,;eE\s]*")
_SPACES = re.compile(r"\s+(?![\[(])")
"""Spaces between columns, but not those between a name and its unit in brackets."""


def separator(line: str) -> str:
    """The character that separates the columns of a line; empty for spaces."""
    most = max(SEPARATORS, key=line.count)
    return most if most in line else ""


def cells(lines: Iterable[str], separated_by: str, strict: bool = False) -> Iterator[list[str]]:
    """The cells of each line. Raises `csv.Error` for broken quotation marks, with `strict` for any that CSV does not allow."""
    if separated_by:
        return csv.reader(lines, delimiter=separated_by, strict=strict)
    return (_SPACES.split(words) if (words := line.strip()) else [] for line in lines)


def table_lines(lines: Iterable[str]) -> Iterator[tuple[int, str]]:
    """The lines of a table with their numbers, from 1; without empty lines and remarks.

    If it begins with numbers, a remark right above them with as many names comes first: `numpy.savetxt` writes names so.
    """
    above, begun = (0, ""), False
    for number, line in enumerate(lines, 1):
        if line.startswith(REMARK):
            above = number, line.lstrip(REMARK).strip()
        elif line.strip() and not line.startswith(OF_EXCEL):
            if not begun and above[1] and _NUMBERS.fullmatch(line) and _columns(above[1]) == _columns(line):
                yield above
            begun = True
            yield number, line


def _columns(line: str) -> int:
    return len(next(cells([line], separator(line)), []))
