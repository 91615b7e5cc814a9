"""Comparisons of two or more recordings: the settings in which they differ, and their metrics."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import inf, isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa

from flexlab.analysis.metrics import MetricCollection, MetricRow, RunMetrics
from flexlab.analysis.metrics.metric import named, numbers
from flexlab.analysis.result import Result, number_column, provenance
from flexlab.analysis.run_summary import scenario_differences
from flexlab.recording.course import coarse_note
from flexlab.recording.overlay import run_label, write_comparison
from flexlab.recording.reader import Recording, read_recording
from flexlab.scenario.field_text import value_text
from flexlab.sim.commands import WorldCommand
from flexlab.text import difference_text as number_difference
from flexlab.text import number_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Table = list[list[str]]
"""A row of headings, then the rows of the table."""
SAME_LENGTH = 1e-9
"""Difference of durations, s, below which two runs count as equally long."""
MOST_COMMANDS = 3
"""Largest number of a run's commands that are listed."""
BETWEEN = "; "
"""What separates them."""
STARTS = {
    "initial.pose": "on the path",
    "initial.pose_rate": "that of the path",
    "initial.beam_coordinates": "undeformed",
}
"""How a run starts where its scenario leaves it open, by field."""
SAME = "All runs started from the same scenario."


@dataclass(frozen=True, eq=False)
class Comparison(Result):
    """A comparison of the runs A, B, C… in the given order."""

    recordings: tuple[Recording, ...]
    """The recordings, without their samples."""
    duration: tuple[float, ...]
    """Duration of each whole run, s."""
    window: float
    """Metrics are taken over each run's first `window` s, the duration of the shortest run that finished (if any did)."""
    metrics: tuple[tuple[MetricRow, ...], ...]
    """One tuple per metric, one row per run."""
    settings: tuple[tuple[str, tuple[str, ...]], ...]
    """(dotted path, value of each run) of every scenario field in which any run differs from A; then the sample period and the
    commands, if they differ."""

    @cached_property
    def table(self) -> Any:
        """A row per run: label, name, duration, status, every metric (SI), every setting that differs, provenance."""
        by_run, names = zip(*self.metrics, strict=True), {number.column.field: number.name for number in numbers()}
        rows = []
        for label, recording, duration, found in zip(self.labels, self.recordings, self.duration, by_run, strict=True):
            about = {"label": label, "run": recording.path.stem, "duration": duration, "status": str(recording.status)}
            values = {
                names[row.column.field]: None if isnan(row.value) else row.value / row.column.scale for row in found
            }
            settings = {path: texts[self.labels.index(label)] for path, texts in self.settings}
            rows.append(about | values | settings | provenance(recording.scenario))
        return pa.Table.from_pylist(rows)

    def plot(self, *metrics: str) -> "Figure":
        """Draw the named metrics of all runs as bars; without names, the metrics in lists of runs. Raises `StudyError`."""
        from flexlab.analysis.figures import draw_bars

        names = metrics or tuple(number.name for number in numbers() if number.column.listed)
        values = {one: one.scale * number_column(self.table, one.name) for one in map(named, names)}
        return draw_bars(self.labels, {one.title: (found, one.column.missing) for one, found in values.items()})

    @property
    def labels(self) -> list[str]:
        """The label of each run: A, B, C and so on."""
        return [run_label(number) for number in range(len(self.recordings))]

    @property
    def window_text(self) -> str:
        """The time span of the metrics, in words."""
        return f"of the first {number_text(self.window)} s of each run"

    def __repr__(self) -> str:
        runs = ", ".join(f"{label} {run.name}" for label, run in zip(self.labels, self.recordings, strict=True))
        return f"<Comparison of {runs}, {self.window_text}, settings that differ: {len(self.settings)}>"

    def repeated(self) -> list[tuple[str, str]]:
        """(label, label of its first occurrence) of every run that was named before."""
        paths = [recording.path.resolve() for recording in self.recordings]
        firsts = [(self.labels[number], self.labels[paths.index(path)]) for number, path in enumerate(paths)]
        return [(label, first) for label, first in firsts if label != first]

    @cached_property
    def coarse(self) -> tuple[str, ...]:
        """A sentence for each run whose samples are too far apart for metrics of its vibration."""
        notes = []
        for run, duration in zip(self.recordings, self.duration, strict=True):
            begin = 0.0 if run.start is None else run.start.tick * run.sample_period
            until = begin + min(duration, self.window)
            notes.append(coarse_note(run.scenario, run.sample_period, until, run.events))
        return tuple(f"{label}: {note}" for label, note in zip(self.labels, notes, strict=True) if note)

    def run_table(self) -> Table:
        """Label, name, duration and scenario of each run."""
        rows = [
            [label, run.path.stem, f"{duration:.4g}", run.scenario.title or run.name]
            for label, run, duration in zip(self.labels, self.recordings, self.duration, strict=True)
        ]
        return [["", "run", "duration (s)", "scenario"], *rows]

    def metric_table(self) -> Table:
        """Each metric that any run has, of each run, and its difference from A's."""
        labels = self.labels
        rows = [
            [rows[0].label, *(row.short for row in rows), *(difference_text(rows[0], row) for row in rows[1:])]
            for rows in self.metrics
            if any(row.applies for row in rows)
        ]
        return [["metric", *labels, *(f"{label} − A" for label in labels[1:])], *rows]

    def setting_table(self) -> Table:
        """The settings that differ; only the headings if none does."""
        return [["setting", *self.labels], *([path, *values] for path, values in self.settings)]

    def as_data(self) -> dict[str, Any]:
        """The comparison as plain data with all digits, in the tables' units; None for a missing value."""
        runs = [
            {"label": label, "run": run.path.stem, "duration [s]": duration, "title": run.scenario.title}
            for label, run, duration in zip(self.labels, self.recordings, self.duration, strict=True)
        ]
        metrics = {rows[0].key: [None if isnan(row.value) else row.value for row in rows] for rows in self.metrics}
        settings = {path: list(values) for path, values in self.settings}
        return {"runs": runs, "window [s]": self.window, "metrics": metrics, "settings": settings}

    def text(self) -> str:
        """The whole comparison as markdown."""
        heads, *settings = self.setting_table()
        settings = [[f"`{path}`", *values] for path, *values in settings]
        parts = ["# Comparison", _markdown(self.run_table())]
        parts += [f"## Metrics {self.window_text}", _markdown(self.metric_table()), *self.coarse]
        parts += ["## Settings", _markdown([heads, *settings]) if settings else SAME]
        return "\n\n".join(parts) + "\n"


def compare(paths: Sequence[Path], seen: Callable[[int], None] = lambda samples: None) -> Comparison:
    """Read recordings and compare them; `seen` is called with the number of samples in each block that was read.

    Raises `RecordingError`.
    """
    recordings = tuple(map(read_recording, paths))
    whole = [_metrics(recording, seen) for recording in recordings]
    durations = tuple(metrics.duration for metrics in whole)
    # A run that stopped early has no metrics, and would leave none of the others' time to compare.
    finished = [time for time, recording in zip(durations, recordings, strict=True) if not recording.status.failed]
    window = min(finished or durations, default=0.0)
    metrics = [
        (found if found.duration - window < SAME_LENGTH else _metrics(recording, seen, window)).rows
        for recording, found in zip(recordings, whole, strict=True)
    ]
    fields = {
        path
        for recording in recordings[1:]
        for path, *_ in scenario_differences(recordings[0].scenario, recording.scenario)
    }
    settings = [(path, tuple(_value(recording, path) for recording in recordings)) for path in sorted(fields)]
    periods = tuple(f"{number_text(recording.sample_period)} s" for recording in recordings)
    for name, values in (("sample_period", periods), ("commands", tuple(map(_commands, recordings)))):
        settings += [(name, values)] if len(set(values)) > 1 else []
    return Comparison(recordings, durations, window, tuple(zip(*metrics, strict=True)), tuple(settings))


def compare_into(paths: Sequence[Path], target: Path) -> Comparison:
    """Compare recordings and write their curves and tables as the rerun file `target`.

    Raises `RecordingError` if a run cannot be read, there are too few or too many, or `target` cannot be written.
    """
    comparison = compare(paths)
    write_comparison(comparison.recordings, target, comparison.text())
    return comparison


def difference_text(first: MetricRow, other: MetricRow) -> str:
    """The difference of a metric from the first run's; "–" if one of them has no value."""
    return number_difference(first.value, other.value, scale=first.column.scale)


def _metrics(recording: Recording, seen: Callable[[int], None], seconds: float = inf) -> RunMetrics:
    """The metrics of a run's first `seconds`; later samples are not read."""
    collection, last = None, inf
    for block in recording.blocks():
        if collection is None:
            last = float(block.time[0]) + seconds
            collection = MetricCollection((float(block.time[0]), last))
        if block.time[0] > last:
            break
        collection.update(block)
        seen(len(block.time))
    return (collection or MetricCollection()).compute(seconds < inf or not recording.status.failed)


def _value(recording: Recording, path: str) -> str:
    """A field's value in words; "–" if the scenario lacks it, as with another kind of damping, or if it is not set."""
    if not recording.scenario.has(path):
        return "–"
    value = recording.scenario.get(path)
    return STARTS.get(path, "–") if value is None else value_text(value)


def _commands(recording: Recording) -> str:
    """The first commands of a run with their times, in words."""
    done = [event for event in recording.events if isinstance(event.command, WorldCommand) and event.level != "error"]
    told = [f"t = {number_text(event.time)} s: {event.text}" for event in done[:MOST_COMMANDS]]
    more = len(done) - len(told)
    return BETWEEN.join([*told, *([f"{more} more"] if more else [])]) or "–"


def _markdown(table: Table) -> str:
    heads, *rows = table
    # Titles and names may hold line breaks and the sign between columns.
    rows = [[" ".join(cell.split()).replace("|", "\\|") for cell in row] for row in rows]
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
