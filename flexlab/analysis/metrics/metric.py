"""Metrics: classes that take in samples piece by piece, registered in the files of this folder.

The same code serves a stream and a whole run: `update` takes in the next piece, `compute` returns the numbers. To add a
metric, copy one from `magnitudes.py` into a new file: tables, lists, notes, comparisons and the Python interface follow from
its columns.

Each number has one name, such as `rms_error.y`, and is in SI units. Names of earlier versions can still be read: short ones,
such as `rms-y`, and titles with units; the numbers they name are in the units of tables, as before.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np

from flexlab.errors import StudyError

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


@dataclass(frozen=True)
class Column:
    """How one number of a metric is shown."""

    field: str
    """Short name from earlier versions, as in `--sort torque`; `Number.name` is the present one."""
    title: str
    heading: str
    """The title where there is little room."""
    unit: str
    """Unit of the number as it is shown."""
    scale: float = 1.0
    """Shown number over SI number."""
    listed: bool = False
    """Whether lists of runs have a column for it."""
    missing: str = "–"
    """The word for NaN."""
    part: str = ""
    """Name among the metric's numbers, such as y in rms_error.y; empty for a single number."""

    @property
    def key(self) -> str:
        """Title and unit, as notes and tables for programs name it."""
        return f"{self.title} [{self.unit}]"

    @property
    def label(self) -> str:
        """Title and unit, as people see it."""
        return label_of(self.key)

    @property
    def si_unit(self) -> str:
        """Unit of the number in Python and in tables for programs."""
        return self.unit if self.scale == 1.0 else _SI[self.unit]


def label_of(key: str) -> str:
    """A `Column.key` as people see it: "Peak vibration (mm)" for "Peak vibration [mm]"."""
    title, _, unit = key.removesuffix("]").rpartition(" [")
    return f"{title} ({unit})" if title and unit != "1" else title or key


_SI = {"mm": "m", "µm": "m", "mrad": "rad", "%": "1"}
"""Unit of tables → SI."""


class Metric(ABC):
    """One or a few numbers about a run. SI units; NaN where they have no value."""

    name: ClassVar[str]
    """Name in Python: `run.metrics.<name>`."""
    place: ClassVar[int]
    """Rank in tables; smaller ones come first."""
    columns: ClassVar[tuple[Column, ...]]
    """One per number of `compute`."""
    own: ClassVar[bool] = False
    """Whether a user declared it for their own studies; a lab does not note it beside its recordings."""

    @abstractmethod
    def update(self, samples: "Samples") -> None:
        """Take in the next piece of a run (N >= 1)."""

    @abstractmethod
    def compute(self) -> tuple[float, ...]:
        """One number per column for all pieces so far; NaN if there are none."""

    def reason(self) -> str:
        """Why there is no number, in a few words; empty if the column's `missing` says enough."""
        return ""


Signal = Callable[["Samples"], np.ndarray]
METRICS: dict[str, type[Metric]] = {}
"""Every metric by its name, in the order of tables."""
MetricClass = TypeVar("MetricClass", bound=type[Metric])


def register(metric: MetricClass, again: bool = False) -> MetricClass:
    """Class decorator: adds a metric to `METRICS`. Raises ValueError for a name, field or title that is taken.

    `again`: whether it may replace the metric of its name.
    """
    others = [other for other in METRICS.values() if not (again and other.name == metric.name)]
    taken = {word for other in others for column in other.columns for word in (other.name, column.field, column.key)}
    for word in (metric.name, *(word for column in metric.columns for word in (column.field, column.key))):
        if word in taken:
            raise ValueError(f"the metric {metric.name} calls something {word!r}, and another one does, too")
    known = metric.name in METRICS
    METRICS[metric.name] = metric
    if known:  # In place: another thread of a cluster's worker may be listing them.
        return metric
    ordered = sorted(METRICS.items(), key=lambda item: item[1].place)
    METRICS.clear()
    METRICS.update(ordered)
    return metric


def forget(name: str) -> None:
    """Remove a metric from `METRICS`, if it is there."""
    METRICS.pop(name, None)


class _OfSignal(Metric):
    @abstractmethod
    def signal(self, samples: "Samples") -> np.ndarray:
        """The signal that is measured, (N, columns); a peak also takes (N, columns, …)."""


class RootMeanSquare(_OfSignal):
    """Base of metrics √(mean of signal²) over all samples.

    A peak in the first sample counts for a whole period: the internal force of the paper's run is 3.6 % larger with samples
    every 1 ms than over time, and 7 % every 2 ms. Compare runs that have the same sample period.
    """

    def __init__(self) -> None:
        self._count = 0
        self._squares = np.zeros(len(self.columns))

    def update(self, samples: "Samples") -> None:
        """Take in the next piece of a run."""
        self._count += len(samples)
        self._squares += np.sum(self.signal(samples) ** 2, axis=0)

    def compute(self) -> tuple[float, ...]:
        """The root of the mean square, a number per column."""
        if self._count == 0:
            return (np.nan,) * len(self.columns)
        return tuple(map(float, np.sqrt(self._squares / self._count)))


def maxima(signal: np.ndarray) -> np.ndarray:
    """The largest number of each column of a signal (N, columns, …)."""
    # Column by column: NumPy is slow over rows of few numbers.
    return np.array([signal[:, column].max() for column in range(signal.shape[1])])


def outlasting(time: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The instants, s, rising, and sizes that no later size reaches: the last one above any limit is among them."""
    largest_later = np.maximum.accumulate(np.append(size[1:], -1.0)[::-1])[::-1]
    return time[size > largest_later], size[size > largest_later]


class Peak(_OfSignal):
    """Base of metrics that are the largest magnitude of a signal."""

    def __init__(self) -> None:
        self._peak = np.full(len(self.columns), -np.inf)

    def update(self, samples: "Samples") -> None:
        """Take in the next piece of a run."""
        sizes = np.abs(self.signal(samples))
        self._peak = np.maximum(self._peak, maxima(sizes))

    def compute(self) -> tuple[float, ...]:
        """The largest magnitude, a number per column."""
        return tuple(float(peak) if peak != -np.inf else np.nan for peak in self._peak)


def of_signal(base: type[Peak | RootMeanSquare], place: int, *columns: Column, **more: Any) -> Callable[[Signal], Any]:
    """Function decorator: makes a metric with that base and the function's name; the function returns the signal (N, columns)."""

    def make(signal: Signal) -> Any:
        about = {"__doc__": signal.__doc__, "__module__": signal.__module__, "signal": staticmethod(signal), **more}
        return type(signal.__name__, (base,), about | {"name": signal.__name__, "place": place, "columns": columns})

    return make


@dataclass(frozen=True)
class Number:
    """One number of a metric, in SI units or in those of tables."""

    metric: str
    index: int
    """Index among the metric's numbers."""
    column: Column
    scale: float = 1.0
    """The number over that in SI units."""

    @property
    def name(self) -> str:
        """Name, as in "rms_error.y", or "peak_torque" for a metric with a single number."""
        return f"{self.metric}.{self.column.part}" if self.column.part else self.metric

    @property
    def title(self) -> str:
        """Title and unit of the number."""
        return f"{self.column.title} ({self.column.si_unit if self.scale == 1.0 else self.column.unit})"


def numbers() -> list[Number]:
    """Every number of every metric, in the order of tables."""
    return [Number(name, *each) for name, metric in METRICS.items() for each in enumerate(metric.columns)]


def number_names() -> list[str]:
    """The names of all numbers of all metrics, in the order of tables."""
    return [number.name for number in numbers()]


def named(word: str) -> Number:
    """The number that a word names. Raises `StudyError` for an unknown word."""
    for number in numbers() if isinstance(word, str) else ():
        column = number.column
        if word == number.name:
            return number
        if word in (column.field, column.key, column.label):
            return replace(number, scale=column.scale)
    parts = [name for name in number_names() if name.startswith(f"{word}.")]
    if parts:
        raise StudyError(f"{word} has several numbers: choose one of {', '.join(parts)}.")
    raise StudyError(f"{word!r:.60} is not a metric: choose one of {', '.join(number_names())}.")
