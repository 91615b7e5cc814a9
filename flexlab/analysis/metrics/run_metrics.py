"""All metrics of a run, or of a window of it: gathered from pieces, shown, and noted.

Notes on a recording hold metrics as numbers by title and unit, None for those without a value.
"""

from collections import namedtuple
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from math import inf, isfinite, isnan, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from flexlab.analysis.metrics.metric import METRICS, Column, Metric, label_of, named, numbers
from flexlab.errors import StudyError
from flexlab.text import MISSING, aligned, html_table, result_text

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples

Window = tuple[float, float]
"""First and last instant, s."""
Noted = Mapping[str, float | None] | None
"""A user's own metrics as noted when the run was recorded, by title and unit, SI."""
DURATION, NOT_FINISHED = "duration", "did not finish"
"""The only metric of a stopped run, and the word for the others."""
ROUNDING = 1e-9
"""Tolerance of a window's limits, s: sample times are products of whole numbers and periods, which are rounded."""


@dataclass(frozen=True)
class MetricRow:
    """A row of a table of metrics, in its units."""

    column: Column
    value: float
    """Value in `column.unit`."""
    finished: bool = True
    """Whether the run reached its end."""
    reason: str = ""
    """Why there is no value, if more is known than the column's word."""

    @property
    def title(self) -> str:
        """Title of the number."""
        return self.column.title

    @property
    def unit(self) -> str:
        """Unit of the value."""
        return self.column.unit

    @property
    def key(self) -> str:
        """Title and unit, as tables for programs name it."""
        return self.column.key

    @property
    def label(self) -> str:
        """Title and unit, as people see it."""
        return self.column.label

    @property
    def text(self) -> str:
        """The value with four digits, or the words for a missing one."""
        return self.reason if self.reason and self.finished and isnan(self.value) else self.short

    @property
    def short(self) -> str:
        """The value for tables of several runs, in a word or two if it is missing."""
        return value_text(self.column, self.value) if self.finished or self.value == self.value else NOT_FINISHED

    @property
    def applies(self) -> bool:
        """Whether the row tells anything: a path without a stop has no residual vibration after it."""
        return self.short != MISSING


def value_text(column: Column, value: Any) -> str:
    """A number with four digits; the column's word for NaN, and "–" for anything but a number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return MISSING
    return column.missing if isnan(value) else result_text(value, column.scale)


class RunMetrics:
    """The metrics of the samples within `window`: `settling_time`, `peak_error`…, in SI units.

    A metric of one number is a float, one of several a tuple; NaN where it has no value. `print` shows a table.
    """

    def __init__(
        self,
        window: Window | None,
        values: dict[str, tuple[float, ...]],
        finished: bool = True,
        reasons: Mapping[str, str] | None = None,
        noted: Noted = None,
        note: str = "",
    ):
        """`window`: first and last instant, s; None without samples. `values`: numbers by metric; `reasons`: why there are none.

        `note`: a remark on all of them. A run that stopped before its end has only a duration: its other metrics are not known.
        """
        self.window, self.note = window, note
        if not finished:
            values = {name: numbers if name == DURATION else (nan,) * len(numbers) for name, numbers in values.items()}
        self._values, self._finished, self._reasons = values, finished, reasons or {}
        known = {column.key for name in values for column in METRICS[name].columns}
        self._noted = {key: nan if value is None else value for key, value in (noted or {}).items() if key not in known}

    def __getattr__(self, name: str) -> Any:
        known = self.__dict__.get("_values", {})
        values = known.get(name)
        if values is None:
            raise AttributeError(f"there is no metric {name!r}: choose one of {', '.join(known)}")
        return values[0] if len(values) == 1 else _parts(name)(*values)

    def __getitem__(self, name: str) -> float:
        """A number by its name, as in "rms_error.y", or its title and unit, SI. Raises `StudyError`."""
        if isinstance(name, str) and name in self._noted:
            return self._noted[name]
        found = named(name)
        if found.metric not in self._values:
            raise StudyError(
                f"The metric {found.name} was declared after these numbers were computed: compute them anew."
            )
        return found.scale * self._values[found.metric][found.index]

    def __dir__(self) -> Iterable[str]:
        return [*super().__dir__(), *self._values]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RunMetrics) and (self.window, self._values) == (other.window, other._values)

    @property
    def rows(self) -> tuple[MetricRow, ...]:
        """All numbers with titles, in the units of tables (mm, mrad) and in their order."""
        found = [
            MetricRow(column, column.scale * value, self._finished, self._reasons.get(name, ""))
            for name, values in self._values.items()
            for column, value in zip(METRICS[name].columns, values, strict=True)
        ]
        for key, value in self._noted.items():
            title, _, unit = key.removesuffix("]").rpartition(" [")
            found.append(MetricRow(Column("", title, title, unit), value, self._finished))
        return tuple(found)

    @property
    def own(self) -> list[str]:
        """Titles and units of the metrics that a user declared for their own studies."""
        declared = [column.key for name in self._values if METRICS[name].own for column in METRICS[name].columns]
        return [*declared, *self._noted]

    def by_name(self) -> dict[str, float]:
        """All numbers, SI, by the names of `metric.numbers`, without metrics that were declared after these were computed."""
        known = (number for number in numbers() if number.metric in self._values)
        return {number.name: self._values[number.metric][number.index] for number in known}

    @property
    def numbers(self) -> tuple[float, ...]:
        """All numbers, SI, in the order of `metric.numbers`."""
        return tuple(value for values in self._values.values() for value in values)

    def as_data(self) -> dict[str, Any]:
        """Plain data with all digits, SI: a number or a list of numbers per metric; None for NaN, which JSON lacks."""
        plain = {name: [None if isnan(value) else value for value in values] for name, values in self._values.items()}
        window = None if self.window is None else list(self.window)
        return {name: values[0] if len(values) == 1 else values for name, values in plain.items()} | {"window": window}

    @property
    def window_text(self) -> str:
        """The window in words."""
        return "no samples" if self.window is None else f"t = {self.window[0]:g} s to {self.window[1]:g} s"

    def __repr__(self) -> str:
        listed = [row for row in self.rows if row.column.listed]
        numbers = ", ".join(f"{row.title} {row.text}{'' if isnan(row.value) else ' ' + row.unit}" for row in listed)
        return f"<RunMetrics of {self.window_text}: {numbers}>"

    def __str__(self) -> str:
        rows = (f"  {line}" for line in aligned([(row.label, row.text) for row in self.rows]))
        return "\n".join([f"Over {self.window_text}:", *rows, *([self.note] if self.note else [])])

    def _repr_html_(self) -> str:
        caption = f"Over {self.window_text}" + (f". {self.note}" if self.note else "")
        return html_table(((row.label, row.text) for row in self.rows), caption=caption)


@cache
def _parts(name: str) -> Any:
    """The class of a tuple of a metric's numbers with named parts, as in `rms_error.y`."""
    return namedtuple(name, [column.part for column in METRICS[name].columns])


class MetricCollection:
    """All metrics, gathered piece by piece, so that long runs need no more memory than short ones."""

    def __init__(self, window: Window = (-inf, inf), own: bool = True):
        """`window`: the window of samples that count, s; `own`: whether to include metrics that a user declared."""
        self._window = window
        self._span: Window | None = None
        self._metrics: dict[str, Metric] = {name: metric() for name, metric in METRICS.items() if own or not metric.own}

    @np.errstate(over="ignore", invalid="ignore")  # Imported values may be of any size.
    def update(self, samples: "Samples") -> None:
        """Take in the next piece of the run; samples outside the window do not count."""
        first, last = self._window
        samples = between(samples, first, last)
        if len(samples) == 0:
            return
        self._span = (float(samples.time[0]) if self._span is None else self._span[0]), float(samples.time[-1])
        for metric in self._metrics.values():
            metric.update(samples)

    @np.errstate(over="ignore", invalid="ignore")
    def compute(self, finished: bool = True, noted: Noted = None, note: str = "") -> RunMetrics:
        """The metrics of all pieces so far; `finished`: whether the run came to its end; others as for `RunMetrics`."""
        found = ((name, metric.compute()) for name, metric in self._metrics.items())
        # A user's metric may be infinite, which neither JSON nor a search for the least can use.
        values = {name: tuple(number if isfinite(number) else nan for number in numbers) for name, numbers in found}
        if self._span is not None and self._span[0] == self._span[1]:  # Numbers of one instant are none of a run.
            lasting = (name for name in values if name != DURATION and not METRICS[name].own)
            values |= {name: (nan,) * len(values[name]) for name in lasting}
        reasons = {name: metric.reason() for name, metric in self._metrics.items()}
        return RunMetrics(self._span, values, finished, reasons, noted, note)


def run_metrics(
    samples: "Samples", window: Window = (-inf, inf), finished: bool = True, own: bool = True, noted: Noted = None
) -> RunMetrics:
    """The metrics of a run within a window, s; `finished`: whether the run came to its end.

    `own` as for `MetricCollection`, `noted` as for `RunMetrics`.
    """
    collection = MetricCollection(window, own)
    collection.update(samples)
    # Imported here so that the help of commands that name metrics does not wait for the engine.
    from flexlab.recording.course import coarse_note
    from flexlab.sim.samples import Run

    note = ""
    if isinstance(samples, Run) and len(samples) > 1:
        last = float(samples.time[-1])
        course = getattr(samples, "_course", None)
        period = (last - float(samples.time[0])) / (len(samples) - 1)
        note = coarse_note(samples.scenario, period, last, () if course is None else course.events)
    return collection.compute(finished, noted, note)


def between(samples: "Samples", first: float, last: float) -> "Samples":
    """The samples from `first` to `last`, s, both included; their times must rise."""
    start, stop = samples.time.searchsorted([first - ROUNDING, last + ROUNDING])
    return samples if stop - start == len(samples) else samples.slice(int(start), int(stop))


def measured(noted: Any) -> bool:
    """Whether the notes have all present metrics; old notes lack newer ones and those whose meaning has changed."""
    return isinstance(noted, Mapping) and all(
        column.key in noted for metric in METRICS.values() if not metric.own for column in metric.columns
    )


def results(noted: Mapping[str, Any], stopped: bool) -> dict[str, Any]:
    """The noted metrics that are valid: only the duration if the run stopped before its end."""
    kept = {column.key for column in METRICS[DURATION].columns}
    return {key: None if stopped and key not in kept else value for key, value in noted.items()}


def noted_text(column: Column, noted: Mapping[str, Any], stopped: bool = False) -> str:
    """A number as a table shows it: "not settled" for a missing value, "–" for a metric that was never measured.

    A run of one instant has nothing to measure. `stopped`: whether the run stopped before its end.
    """
    if column.key not in noted:
        return MISSING
    if noted[column.key] is None and not stopped and noted.get(METRICS[DURATION].columns[0].key) == 0:
        return MISSING
    value = results(noted, stopped)[column.key]
    if value is None and stopped:
        return NOT_FINISHED
    return value_text(column, nan if value is None else value)


def noted_value(column: Column, noted: Mapping[str, Any], stopped: bool = False) -> float:
    """The number by which a page sorts; missing values come last."""
    value = results(noted, stopped).get(column.key)
    usable = isinstance(value, (int, float)) and not isinstance(value, bool)
    return float(value) if usable else 1e300 if column.key in noted else 2e300


def noted_texts(noted: Mapping[str, Any], stopped: bool = False) -> dict[str, str]:
    """All noted metrics that have a value or a word, by title and unit as people see it, also those unknown to this version."""
    columns = {column.key: column for metric in METRICS.values() for column in metric.columns}
    texts = {
        label_of(str(key)): noted_text(columns[key], noted, stopped)
        if key in columns
        else value_text(Column("", "", "", ""), value)
        for key, value in noted.items()
    }
    return {label: text for label, text in texts.items() if text != MISSING}
