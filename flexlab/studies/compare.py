"""Two or more recordings side by side: what was set differently, and what came of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flexlab.recording.comparison import run_label, write_comparison
from flexlab.recording.reader import Recording, read_recording
from flexlab.studies.library import scenario_differences
from flexlab.studies.metrics import MetricRow, metric_rows, run_metrics


@dataclass(frozen=True)
class Comparison:
    """Of the runs A, B, C… in the order they were given."""

    recordings: tuple[Recording, ...]
    metrics: tuple[tuple[MetricRow, ...], ...]
    """One tuple per metric, one row per run."""
    settings: tuple[tuple[str, tuple[str, ...]], ...]
    """(dotted path, value of each run) of every scenario field in which any run differs from A."""

    def text(self) -> str:
        """Both tables and the list of runs as markdown."""
        labels = [run_label(number) for number in range(len(self.recordings))]
        runs = [
            f"- **{label}**: {run.path.stem} ({run.scenario.title or run.name})"
            for label, run in zip(labels, self.recordings, strict=True)
        ]
        heads = [*labels, *(f"{label} - A" for label in labels[1:])]
        metrics = [
            [f"{rows[0].title} [{rows[0].unit}]", *(f"{row.value:.4g}" for row in rows)]
            + [f"{row.value - rows[0].value:+.3g}" for row in rows[1:]]
            for rows in self.metrics
        ]
        settings = [[f"`{path}`", *values] for path, values in self.settings]
        parts = ["# Comparison", "\n".join(runs), "## Metrics", _table(["metric", *heads], metrics), "## Settings"]
        parts.append(_table(["field", *labels], settings) if settings else "All runs started from the same scenario.")
        return "\n\n".join(parts) + "\n"


def compare(paths: Sequence[Path]) -> Comparison:
    """Read recordings and compare them. Raises `RecordingError`."""
    recordings = tuple(read_recording(path) for path in paths)
    metrics = [metric_rows(run_metrics(recording.samples)) for recording in recordings]
    fields = {
        path
        for recording in recordings[1:]
        for path, _, _ in scenario_differences(recordings[0].scenario, recording.scenario)
    }
    settings = [(path, tuple(_value(recording, path) for recording in recordings)) for path in sorted(fields)]
    return Comparison(recordings, tuple(zip(*metrics, strict=True)), tuple(settings))


def compare_into(paths: Sequence[Path], target: Path) -> Comparison:
    """Compare recordings and write the overlay, with the tables beside it, as the rerun file `target`.

    Raises `RecordingError` if a run cannot be read, there are too few or too many, or `target` cannot be written.
    """
    comparison = compare(paths)
    write_comparison(comparison.recordings, target, comparison.text())
    return comparison


def _value(recording: Recording, path: str) -> str:
    """A field's value in words; "–" where a scenario has no such field (another kind of damping, say)."""
    value = recording.scenario
    for name in path.split("."):
        value = getattr(value, name, None)
        if value is None:
            return "–"
    if isinstance(value, float):
        return f"{value:g}"
    return str(getattr(value, "kind", value))


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
