"""Checks of arguments of the Python interface: each returns the value in one type, or raises `StudyError` with a sentence."""

import math
import numbers
import os
from pathlib import Path
from typing import Any

import numpy as np

from flexlab.errors import StudyError
from flexlab.text import number_text


def file_path(name: str, value: str | Path) -> Path:
    """The argument `name` as a path."""
    try:
        usable = isinstance(value, (str, Path)) and bool(str(value)) and b"\0" not in os.fsencode(value)
    except UnicodeEncodeError:  # half of a pair of surrogates
        usable = False
    if not usable:
        raise StudyError(f"{name} = {value!r:.60} is not a path: give one as text, as in 'study/first'.")
    return Path(value)


def flag(name: str, value: Any) -> bool:
    """True or False, and nothing else: Python would take nearly anything for True."""
    if not isinstance(value, (bool, np.bool_)):
        raise StudyError(f"{name} = {value!r:.60} is not usable: give True or False.")
    return bool(value)


def text_or_none(name: str, value: Any, example: str) -> str | None:
    """A text, or None for the default."""
    if value is not None and not (isinstance(value, str) and value):
        raise StudyError(f"{name} = {value!r:.60} is not usable: give a text, as in {example!r}.")
    return value


def finite_number(name: str, value: Any, unit: str = "", low: float = -math.inf) -> float:
    """A finite number of at least `low`."""
    try:
        usable = isinstance(value, numbers.Real) and not isinstance(value, bool) and math.isfinite(float(value))
    except OverflowError:  # a whole number too large for a float
        usable = False
    if not usable or value < low:
        least = "" if low == -math.inf else f" of at least {number_text(low)}"
        words = f" {unit}" if unit else ""
        raise StudyError(f"{name} = {value!r:.60}{words} is not usable: give a finite number{least}.")
    # A number of single precision means the decimal that it shows: 0.01, not 0.00999999977648258.
    return float(str(value)) if isinstance(value, np.floating) else float(value)


def time_or_none(name: str, value: Any) -> float | None:
    """A time in s, or None for no limit."""
    return None if value is None else finite_number(name, value, "s")


def whole_number(name: str, value: Any, low: int, high: float = math.inf) -> int:
    """A whole number from `low` to `high`."""
    if isinstance(value, bool) or not isinstance(value, numbers.Integral) or not low <= int(value) <= high:
        allowed = f"of at least {low}" if high == math.inf else f"from {low} to {high}"
        raise StudyError(f"{name} = {value!r:.60} is not usable: give a whole number {allowed}.")
    return int(value)
