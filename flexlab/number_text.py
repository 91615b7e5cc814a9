"""How numbers are written for people, and read from them, everywhere: panel, pages, sentences, tables."""

from decimal import Decimal
from math import isfinite, nan

MISSING = "–"
"""What stands where there is no number."""
SMALLEST, LARGEST = Decimal("1e-4"), Decimal("1e7")
"""Sizes between which all digits are written out; others get a power of ten."""
ROUNDING = 1e-12
"""Share of the larger of two numbers below which their difference is nothing but rounding."""
RESIDUE = 1e-11
"""SI size below which a result is nothing but rounding: of poses of 1 m, angles of 1 rad, forces up to 10 kN."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def typed_number(text: str) -> float:
    """The finite number that a text says; NaN for anything else."""
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


def result_text(value: float, scale: float = 1.0) -> str:
    """A computed number, `scale` times its size in SI, with four digits; 0 where it is nothing but rounding."""
    return "0" if abs(value) < RESIDUE * scale else number_text(value)


def fixed_text(value: float, decimals: int, signed: bool = False) -> str:
    """A number with as many decimals whatever its size, for columns and readouts: zero has no sign."""
    if not isfinite(value):
        return MISSING
    text = f"{abs(value):.{decimals}f}"
    if not float(text):
        return text
    return f"{'−' if value < 0 else '+' if signed else ''}{text}"


def difference_text(value: float, other: float, digits: int = 3, scale: float = 1.0) -> str:
    """How far `other` is from `value`, both `scale` times SI, with its sign; 0 where only rounding tells them apart."""
    difference = other - value
    if isfinite(difference) and abs(difference) <= max(RESIDUE * scale, ROUNDING * max(abs(value), abs(other))):
        return "0"
    return number_text(difference, digits, signed=True)


def plain(size: Decimal) -> str:
    """All digits of a number, without a power of ten and without zeros at the end of its decimals."""
    text = f"{size:f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
