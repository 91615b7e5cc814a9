"""The one way of naming a metric's number, as in `rms_error.y`, in SI units; names of earlier versions are still read.

Those are short ones, as in `rms-y`, and titles with units: their numbers are in the units of tables, as they were.
"""

from dataclasses import dataclass

from flexlab.analysis.metrics.metric import METRICS, Column
from flexlab.errors import StudyError


@dataclass(frozen=True)
class Number:
    """One number of a metric."""

    metric: str
    index: int
    """Which of the metric's numbers."""
    column: Column

    @property
    def name(self) -> str:
        """As in "rms_error.y", or "peak_torque" of a metric that is one number."""
        return f"{self.metric}.{self.column.part}" if self.column.part else self.metric


@dataclass(frozen=True)
class Named:
    """A number by one of its names."""

    number: Number
    scale: float
    """Number that the name stands for over the one in SI units."""
    unit: str

    @property
    def title(self) -> str:
        """What is measured, and in which unit."""
        return f"{self.number.column.title} ({self.unit})"


def numbers() -> list[Number]:
    """Every number of every metric, in the order of tables."""
    return [
        Number(name, index, column) for name, metric in METRICS.items() for index, column in enumerate(metric.columns)
    ]


def number_names() -> list[str]:
    """Their names."""
    return [number.name for number in numbers()]


def named(word: str) -> Named:
    """What a name stands for. Raises `StudyError` for a word that names no number."""
    for number in numbers():
        column = number.column
        if word == number.name:
            return Named(number, 1.0, column.si_unit)
        if word in (column.field, column.key):
            return Named(number, column.scale, column.unit)
    parts = [name for name in number_names() if name.startswith(f"{word}.")]
    if parts:
        raise StudyError(f"{word} has several numbers: choose one of {', '.join(parts)}.")
    raise StudyError(f"{word!r:.60} is no metric: choose one of {', '.join(number_names())}.")
