"""Text that is safe to show: numbers, texts from files and visitors, log lines, and HTML for notebooks."""

import ast
import logging
import re
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Iterable, Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from html import escape
from math import isfinite, nan
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from rich.console import Console


MISSING = "–"
"""Shown in place of a missing number."""
SMALLEST, LARGEST = Decimal("1e-4"), Decimal("1e7")
"""Magnitudes between which numbers are written without a power of ten."""
ROUNDING = 1e-12
"""Relative difference below which two numbers differ only by rounding."""
RESIDUE = 1e-11
"""SI magnitude below which a result is only rounding, for poses of 1 m, angles of 1 rad and forces up to 10 kN."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def typed_number(text: str) -> float:
    """The finite number in a text; NaN for anything else."""
    try:
        number = float(text)
    except ValueError:
        return nan
    return number if isfinite(number) else nan


def number_text(value: float, digits: int = 4, signed: bool = False) -> str:
    """A number with `digits` significant digits and a real minus sign, as in 1000, −0.5 and 2.5 · 10⁻⁹; "–" for none.

    `signed`: with a plus sign too.
    """
    if not isfinite(value):
        return MISSING
    shown = Decimal(f"{value:.{digits}g}")
    if not shown:
        return "0"
    sign = "−" if shown < 0 else "+" if signed else ""
    size = abs(shown)
    if SMALLEST <= size < LARGEST:
        return sign + plain(size)
    exponent = size.adjusted()
    mantissa, power = plain(size.scaleb(-exponent)), f"10{str(exponent).translate(_RAISED)}"
    return sign + (power if mantissa == "1" else f"{mantissa} · {power}")


def range_text(low: float, high: float, digits: int = 4) -> str:
    """A range as in "0.001 to 1.234", whose limits are rounded inwards: the range 0 to 1.2347 does not hold 1.235."""
    ends = [Decimal(str(end)) for end in (low, high)]
    shown = [Context(digits, way).plus(end) for end, way in zip(ends, (ROUND_CEILING, ROUND_FLOOR), strict=True)]
    if shown[0] > shown[1]:
        return range_text(low, high, digits + 1)
    return " to ".join(number_text(float(end), digits) for end in shown)


def result_text(value: float, scale: float = 1.0) -> str:
    """A computed number, `scale` times its SI value, with four digits; 0 if it is only rounding."""
    return "0" if abs(value) < RESIDUE * scale else number_text(value)


def fixed_text(value: float, decimals: int, signed: bool = False) -> str:
    """A number with a fixed number of decimals, for columns and readouts; zero has no sign."""
    if not isfinite(value):
        return MISSING
    text = f"{abs(value):.{decimals}f}"
    if not float(text):
        return text
    return f"{'−' if value < 0 else '+' if signed else ''}{text}"


def difference_text(value: float, other: float, scale: float = 1.0) -> str:
    """The signed difference of `other` from `value`, both `scale` times SI; 0 if they differ only by rounding."""
    difference = other - value
    if isfinite(difference) and abs(difference) <= max(RESIDUE * scale, ROUNDING * max(abs(value), abs(other))):
        return "0"
    return number_text(difference, 3, signed=True)


def speed_text(speed: float) -> str:
    """A speed as "1/64 ×", "1 ×", "4 ×"."""
    return f"1/{round(1 / speed)} ×" if speed < 1 else f"{number_text(speed)} ×"


def plain(size: Decimal) -> str:
    """All digits of a number, without a power of ten and without zeros at the end of its decimals."""
    text = f"{size:f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


_INDEXED = re.compile(r"(?<![\w.\\-])([^\W\d_][\u0300-\u036f]*)_((?:(?![²³])[^\W_]){1,4})(?!(?![²³])\w|\.[^\W\d_])")
"""A letter with an index, as f_d or |w_qs|, but not a name in code. `language.js` finds the same ones in pages."""


def with_subscripts(html: str) -> str:
    """Escaped text whose symbols have real subscripts: f_d becomes f<sub>d</sub>."""
    return _INDEXED.sub(r"\1<sub>\2</sub>", html)


_NUMBERED = re.compile(r"(?<![\w.])([^\W\d_][\u0300-\u036f]*)(\d)(?![^\W²³]|\.\w)")
"""A letter with a digit behind it, as k0, θ2 or b̂0, but not a name in code."""
_LOWERED = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def with_indices(text: str) -> str:
    """Text whose numbered symbols have an index: k0 becomes k₀."""
    return _NUMBERED.sub(lambda found: found[1] + found[2].translate(_LOWERED), text)


def in_mathtext(text: str) -> str:
    """Text for a figure whose symbols have real subscripts, in matplotlib's notation."""
    return _INDEXED.sub(r"\1$_{\\mathrm{\2}}$", text.replace("$", r"\$"))


REPLACEMENT = "\N{REPLACEMENT CHARACTER}"
CONTROL_PICTURES = 0x2400
"""Unicode's pictures of the 32 control characters follow one another from here: escape is ␛."""
DELETE, DELETE_PICTURE = 0x7F, 0x2421
_PICTURES = {code: CONTROL_PICTURES + code for code in range(0x20) if chr(code) not in "\t\n"}
_PICTURES[DELETE] = DELETE_PICTURE
# Without pictures: C1 controls, changes of the writing direction, other line ends, invisible letters (some of them are valid
# in Python names), tags, and lone surrogates. Those that emoji need stay.
_WITHOUT_PICTURE = re.compile(
    "[\x80-\x9f\xad\u034f\u061c\u115f\u1160\u17b4\u17b5\u180b-\u180f\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f"
    "\u3164\ufe00-\ufe0e\ufeff\uffa0\ufff9-\ufffb\ud800-\udfff\U0001d173-\U0001d17a\U000e0000-\U000e0fff]"
)
_OBEYED = re.compile(f"\x7f|{_WITHOUT_PICTURE.pattern}")
_BEYOND_ASCII = re.compile("[^\x00-\x7e]")
_BEFORE_UNIT = re.compile(
    r"(?<=[\d⁰¹²³⁴⁵⁶⁷⁸⁹]) (?=(?:[kmµ]?m|[km]?s|1/s|k?Hz|[km]?N|N·m|m?J|mrad|rad|kg|micrometres|[kMG]B|%)\b|%)"
    r"|(?<=[=≈≤≥×]) (?=[+−-]?\d)| (?=[=≈≤≥×] [+−-]?\d)"
)
PARSER = threading.RLock()
"""Held while Python parses a text: in 3.11, two threads at once fail with a SystemError (python/cpython#106905).
`inspect.getsource` of a class parses, too."""


def syntax_tree(source: str, mode: Literal["exec", "eval"] = "exec") -> Any:
    """The syntax tree of Python source, as `ast.parse` returns and raises; safe from any thread."""
    with PARSER, warnings.catch_warnings():
        warnings.simplefilter("ignore", SyntaxWarning)  # It would name no file. Whatever runs the source warns again.
        return ast.parse(source, mode=mode)


def counted(count: int, thing: str) -> str:
    """A number of things: "1 sample", "2 samples"."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def aligned(rows: Sequence[Sequence[str]], right: int = 0) -> list[str]:
    """A line per row, with columns of equal width, the first `right` of them right-aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            cell.rjust(width) if k < right else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def with_units(text: str) -> str:
    """`text` in which no line breaks between a number and its unit, nor around the sign before a number, as in t = 1 s."""
    return _BEFORE_UNIT.sub("\N{NO-BREAK SPACE}", text)


def visible(text: object, longest: int | None = None) -> str:
    """`text` with control characters as pictures, fit for UTF-8; cut with "…" to `longest` characters if given.

    Line breaks and tabs stay.
    """
    words = str(text)
    if longest is not None and len(words) > longest:
        words = words[: longest - 1] + "…"
    if words.isascii() and words.isprintable():  # As nearly all of the thousands of words of a long list of runs.
        return words
    return _WITHOUT_PICTURE.sub(REPLACEMENT, words.translate(_PICTURES))


def visible_json(text: str, ascii_only: bool = False) -> str:
    """The same JSON with the control characters that `json.dumps` does not escape written as escapes.

    `ascii_only`: all characters that ASCII lacks, too.
    """

    def escape(found: re.Match[str]) -> str:
        units = found[0].encode("utf-16-be", "surrogatepass")
        return "".join(f"\\u{units[at : at + 2].hex()}" for at in range(0, len(units), 2))

    return (_BEYOND_ASCII if ascii_only else _OBEYED).sub(escape, text)


def console(stderr: bool = False) -> "Console":
    """A terminal that shows every text as `visible` does, without markup, emoji names or links."""
    from rich.console import Console
    from rich.segment import Segment
    from rich.text import Text

    class PlainConsole(Console):
        def render_str(self, text: str, **options: Any) -> Any:
            return super().render_str(visible(text), **options)

        def render(self, renderable: Any, options: Any = None) -> Iterable[Segment]:
            # Before lines are wrapped: a picture is wider than its control character, and would be cut off.
            if isinstance(renderable, Text):
                renderable = renderable.copy()
                renderable.plain = visible(renderable.plain)
            for part in super().render(renderable, options):
                yield part if part.control else Segment(visible(part.text), part.style)

        def on_broken_pipe(self) -> None:
            # rich itself would end the program, with the exit code of a failed run.
            raise BrokenPipeError

    return PlainConsole(stderr=stderr, highlight=False, markup=False, emoji=False)


class PlainFormatter(logging.Formatter):
    """Writes lines of a log as `visible` shows them."""

    def format(self, record: logging.LogRecord) -> str:
        """The line."""
        return visible(super().format(record))


LINE_PERIOD = 1.0
"""Interval between log lines of one kind after a burst of them, s."""
BURST = 200.0
"""Log lines of one kind that may come at once."""
MOST_LINES = 200
"""Most kinds of log lines that are counted."""


class OneASecond(logging.Filter):
    """Limits the records of each logger and message template, so that nobody can flood a log."""

    def __init__(self) -> None:
        super().__init__()
        self._seen: dict[tuple[str, str], tuple[float, float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Whether the record is written; the first after a pause says how many were left out."""
        key, now = (record.name, str(record.msg)[:200]), time.monotonic()
        if key not in self._seen and len(self._seen) >= MOST_LINES:
            self._seen.clear()
        at, credit, left_out = self._seen.get(key, (now, BURST, 0))
        credit = min(BURST, credit + (now - at) / LINE_PERIOD)
        if credit < 1.0:
            self._seen[key] = now, credit, left_out + 1
            return False
        self._seen[key] = now, credit - 1.0, 0
        if left_out:
            record.msg, record.args = f"{record.getMessage()} (and {left_out} more like this)", ()
        return True


def limited(name: str) -> logging.Logger:
    """The limited logger of a module, or of a library, that logs what visitors do."""
    logger = logging.getLogger(name)
    if not any(isinstance(present, OneASecond) for present in logger.filters):
        logger.addFilter(OneASecond())
    return logger


def tell_failures_plainly() -> None:
    """Make this process print logs and tracebacks as `visible` shows them, and no warnings about arithmetic.

    A run whose numbers overflow says so in a sentence; NumPy's warning would add a line of source. Other warnings are cut to
    their first line: numba adds a traceback to its warning about a variable that it cannot read.
    """
    warnings.filterwarnings("ignore", "(overflow|invalid value|divide by zero) encountered", RuntimeWarning)
    warnings.formatwarning = lambda message, *_, **__: visible(str(message).partition("\n")[0]) + "\n"
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(PlainFormatter())

    def tell(kind: type[BaseException], error: BaseException | None, trace: TracebackType | None) -> None:
        if sys.stderr is not None and not issubclass(kind, SystemExit):
            sys.stderr.write(visible("".join(traceback.format_exception(kind, error, trace))))

    sys.excepthook = tell
    threading.excepthook = lambda told: tell(told.exc_type, told.exc_value, told.exc_traceback)


def writable(value: Any) -> Any:
    """A value from JSON whose texts, names included, can be encoded: lone surrogates are replaced."""
    if isinstance(value, str):
        return value.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")
    if isinstance(value, dict):
        return {writable(name): writable(part) for name, part in value.items()}
    return [writable(part) for part in value] if isinstance(value, list) else value


def shown(text: str, longest: int = 20) -> str:
    """A typed text for use in a sentence: quoted, shortened, without control characters."""
    return f"'{visible(text, longest)}'"


LONGEST_ON_PAGE = 2000
"""Most characters of somebody else's text that a page shows."""


def escaped(text: str) -> str:
    """Text escaped for HTML; texts from files and people are never shown without this."""
    short = text if len(text) <= LONGEST_ON_PAGE else text[:LONGEST_ON_PAGE] + " …"
    return escape(visible(short)).replace("\n", "<br>")


CELL_HEIGHT = 640
"""Height of a notebook's cell, px."""


class Page:
    """An HTML page that notebooks show in their cell; `html` is its text, to be saved as a file."""

    def __init__(self, html: str):
        self.html = html

    def __repr__(self) -> str:
        return f"<Page of {len(self.html.encode()) / 1e6:.1f} MB: a notebook shows it; .html is its text>"

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self.html)}" width="100%" height="{CELL_HEIGHT}" style="border:0"></iframe>'


def html_table(rows: Iterable[Sequence[object]], heads: Sequence[str] = (), caption: str = "") -> str:
    """An HTML table of plain texts; without `heads`, each row's first cell is its head."""

    def cell(kind: str, value: object) -> str:
        return f"<{kind}>{with_subscripts(escape(with_units(str(value))))}</{kind}>"

    lines = ["".join(cell("th", head) for head in heads)] if heads else []
    for first, *others in rows:
        lines.append(cell("td" if heads else "th", first) + "".join(cell("td", value) for value in others))
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{title}{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"
