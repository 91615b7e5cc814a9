"""The notes on a run in the library: its metrics, and its differences from the preset."""

from math import inf, isfinite
from pathlib import Path
from typing import Any

from flexlab.analysis.metrics import MetricCollection, RunMetrics
from flexlab.analysis.metrics.run_metrics import measured, results
from flexlab.errors import FlexlabError, RecordingError
from flexlab.presets import load_preset, preset_names
from flexlab.recording.reader import read_recording
from flexlab.recording.store.notes import read_notes, write_notes
from flexlab.recording.store.run_files import list_runs, run_state
from flexlab.recording.store.run_index import read_row
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import differences, told, value_text
from flexlab.sim.commands import ChangeScenario, LoadScenario
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import Event

DIGITS = 4
"""Significant digits of metrics in the notes, which are for reading only."""


class MetricNotes:
    """The notes of one run, gathered while it is written or read (see `flexlab.recording.run_info`)."""

    def __init__(self, name: str, scenario: Scenario, metrics: RunMetrics | None = None):
        """`name`: the preset or file of `scenario`, the run's first. `metrics`: those of a finished run.

        Otherwise they are computed from the samples, without a person's own ones, which may keep all samples in memory.
        """
        self._known = metrics
        self._metrics = MetricCollection(own=False)
        self._changes = preset_changes(name, scenario)
        self._events = 0
        self._begins = inf

    def add(self, samples: Samples) -> None:
        """Add a block of samples (N >= 1)."""
        self._begins = min(self._begins, float(samples.time[0]))
        if self._known is None:
            self._metrics.update(samples)

    def add_event(self, event: Event) -> None:
        """Add the next event."""
        self._events += 1
        command = event.command
        origin = command.origin if isinstance(command, LoadScenario) else None
        # The event of leaving for another run looks alike, but comes at the run's end.
        if self._events == 1 and origin is not None and event.time == origin.time:
            self._changes.insert(0, event.text)
        elif isinstance(command, ChangeScenario) and event.level != "error":
            self._changes.append(f"t = {event.time:.3f} s: {event.text}")

    def metrics(self, status: Status) -> RunMetrics:
        """The metrics of a run that has ended with `status`."""
        return self._known or self._metrics.compute(not status.failed)

    def result(self, status: Status) -> dict[str, Any]:
        """Metrics, differences from the preset, first instant and duration, s.

        A run that never left its first instant, as in a lab that nobody watched, has only a duration.
        """
        metrics = self.metrics(status)
        values = {row.key: float(f"{row.value:.{DIGITS}g}") for row in metrics.rows}
        # None for NaN, which JSON lacks.
        values = {key: value if isfinite(value) else None for key, value in values.items()}
        return {
            "metrics": results(values, stopped=not metrics.duration > 0),
            **({"own_metrics": metrics.own} if metrics.own else {}),
            "changes": self._changes,
            "begins": self._begins if isfinite(self._begins) else 0.0,
            "duration": metrics.duration,
        }


def note_metrics(path: Path) -> dict[str, Any]:
    """Write the notes of a recording that has none, and return them; empty for a run that is being recorded.

    Raises `RecordingError` if the run cannot be read.
    """
    if run_state(path) == "in use":
        return {}
    recording = read_recording(path)
    gathering = MetricNotes(recording.name, recording.scenario)
    for event in recording.events:
        gathering.add_event(event)
    for block in recording.blocks():
        gathering.add(block)
    notes, row = gathering.result(recording.status), read_row(path)
    notes["status"] = str(recording.status)
    notes["metrics"] |= {key: row.metrics[key] for key in row.own_metrics if key in row.metrics}
    try:
        write_notes(path, **notes)
    except OSError as error:
        raise RecordingError(f"The notes on {path.name} cannot be written ({error.strerror}).") from None
    return notes


def note_missing_metrics(logs: Path) -> int:
    """Write the notes of every finished run without metrics, newest first; return how many. Unreadable runs are left out."""
    count = 0
    for path in list_runs(logs):
        if not measured(read_notes(path).get("metrics")) and run_state(path) in ("complete", "recovered"):
            try:
                count += bool(note_metrics(path))
            except (FlexlabError, OSError):
                continue
    return count


def preset_changes(name: str, scenario: Scenario) -> list[str]:
    """A line per field that differs from the preset `name`; none if there is no such preset."""
    # The name of a run may be that of a preset, followed by the changes.
    known = [preset for preset in preset_names() if name == preset or name.startswith(f"{preset}-")]
    try:
        preset = load_preset(max(known, key=len, default=name))
    except FlexlabError:
        return []
    return [f"{path}: {old} → {new}" for path, old, new in scenario_differences(preset, scenario)]


def scenario_differences(one: Scenario, other: Scenario) -> list[tuple[str, str, str]]:
    """(dotted path, value in `one`, value in `other`) of every field that differs, without titles and texts."""
    return [(path, value_text(old), value_text(new)) for path, old, new in told(differences(one, other))]
