"""What the library says of a run beyond its file: metrics and what was changed against the preset, kept in its notes."""

from pathlib import Path
from typing import Any

from pydantic import BaseModel

from flexlab.errors import FlexlabError, RecordingError
from flexlab.presets import load_preset
from flexlab.recording.reader import Recording, read_blocks, read_recording
from flexlab.recording.run_files import list_runs, read_notes, run_state, write_notes
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, LoadScenario
from flexlab.studies.metrics import MetricSums, metric_rows

DIGITS = 4
"""Significant digits of a metric in the notes: for reading, not for computing."""


def note_metrics(path: Path) -> dict[str, Any]:
    """Read a finished recording, write its metrics and changes into the notes beside it, and return those.

    Does nothing for a run that is being written. Raises `RecordingError` if the run cannot be read.
    """
    if run_state(path) == "in use":
        return {}
    recording, sums = read_recording(path, with_samples=False), MetricSums()
    for block in read_blocks(path):
        sums.add(block)
    metrics = sums.result()
    notes = {
        "metrics": {
            f"{row.title} [{row.unit}]": float(f"{row.value:.{DIGITS}g}")
            for row in metric_rows(metrics)
            if row.value == row.value
        },
        "changes": changes_text(recording),
        "duration": metrics.duration,
    }
    try:
        write_notes(path, **notes)
    except OSError as error:
        raise RecordingError(f"The notes on {path.name} cannot be written ({error.strerror}).") from None
    return notes


def note_missing_metrics(logs: Path) -> int:
    """Do that for every finished run that has none yet, newest first; returns how many. Unreadable ones are passed over."""
    count = 0
    for path in list_runs(logs):
        if "metrics" not in read_notes(path) and run_state(path) in ("complete", "recovered"):
            try:
                count += bool(note_metrics(path))
            except FlexlabError:
                continue
    return count


def changes_text(recording: Recording) -> list[str]:
    """One line per field that differs from the preset at the start, and per change during the run."""
    lines = []
    try:
        preset = load_preset(recording.name)
    except FlexlabError:
        preset = None
    if preset is not None:
        lines = [f"{path}: {old} → {new}" for path, old, new in scenario_differences(preset, recording.scenario)]
    first = recording.events[0] if recording.events else None
    if first is not None and isinstance(first.command, LoadScenario) and first.command.origin is not None:
        # A run that was left for another one says so too, but at its end.
        lines.insert(0, first.text)
    for event in recording.events:
        if isinstance(event.command, ChangeScenario) and event.level != "error":
            lines.append(f"t = {event.time:.3f} s: {event.text}")
    return lines


def scenario_differences(one: Scenario, other: Scenario) -> list[tuple[str, str, str]]:
    """(dotted path, value in `one`, value in `other`) of every field that differs; titles and texts do not count."""
    return [item for item in _differences(one, other, "") if item[0] not in ("title", "watch")]


def _differences(one: Any, other: Any, path: str) -> list[tuple[str, str, str]]:
    if one == other:
        return []
    if isinstance(one, BaseModel) and type(one) is type(other):
        names = type(one).model_fields
        found = [_differences(getattr(one, n), getattr(other, n), f"{path}.{n}" if path else n) for n in names]
        return [item for group in found for item in group]
    return [(path, _text(one), _text(other))]


def _text(value: Any) -> str:
    if isinstance(value, BaseModel):
        return str(getattr(value, "kind", type(value).__name__))
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_text, value)) + "]"
    return "none" if value is None else str(value)
