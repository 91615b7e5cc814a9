"""What the server has done to runs in processes of their own: each function is one job."""

import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from flexlab.analysis.comparison import compare
from flexlab.analysis.metrics import MetricRow
from flexlab.analysis.replay import replay
from flexlab.analysis.resume import resume
from flexlab.analysis.run_summary import note_metrics
from flexlab.errors import RecordingError
from flexlab.recording.export import export_recording
from flexlab.recording.importing import import_into
from flexlab.recording.overlay import write_comparison
from flexlab.recording.reader import read_blocks, read_recording
from flexlab.recording.store.notes import is_regular, notes_path, read_notes
from flexlab.recording.store.run_files import SUFFIX, remove_run
from flexlab.scenario.field_text import field_title
from flexlab.server.labs.lab_provider import Choice
from flexlab.server.labs.quota import Quota
from flexlab.sim.samples import Samples

MOST_SAMPLES = 1_200_000
"""Of a run that is needed whole: 20 minutes at a lab's rate, 0.6 GB in memory."""


@dataclass(frozen=True)
class SettingRow:
    """A field in which runs differ."""

    title: str
    """With symbol and unit."""
    values: tuple[str, ...]


@dataclass(frozen=True)
class ComparisonTables:
    """What a comparison's page says beside the curves."""

    window: str
    """What the metrics speak of, in words."""
    metrics: tuple[tuple[MetricRow, ...], ...]
    """One tuple per metric, one row per run."""
    settings: tuple[SettingRow, ...]


def compare_runs(paths: tuple[Path, ...], target: Path) -> ComparisonTables:
    """Compare runs and write their overlay as the rerun file `target`."""
    for path in paths:
        check_size(path)
    comparison = compare(paths)
    write_comparison(comparison.recordings, target, comparison.text())
    scenarios = [recording.scenario for recording in comparison.recordings]
    settings = (SettingRow(field_title(path, *scenarios), values) for path, values in comparison.settings)
    return ComparisonTables(comparison.window_text, comparison.metrics, tuple(settings))


def check_size(path: Path) -> None:
    """Raises `RecordingError` for a run that does not fit into memory whole."""
    rows = read_notes(path).get("rows", 0)
    if isinstance(rows, int) and rows > MOST_SAMPLES:
        raise RecordingError(
            f"{path.stem} has {rows} samples, over {MOST_SAMPLES}: export a range of its time and import that first."
        )


def replay_run(path: Path, report: Callable[[float], None]) -> tuple[bool, str]:
    """(whether the run came out again, the finding as a sentence); `report` is told how far it is, 0 to 1."""
    _, last = recorded_span(path)

    def blocks() -> Iterator[Samples]:
        for block in read_blocks(path):
            yield block
            report(float(block.time[-1]) / last if last else 1.0)

    found = replay(read_recording(path, with_samples=False), blocks())
    return found.agrees, found.text


def choice_at(path: Path, time: float | None) -> Choice:
    """What a lab is to open to go on from a run at `time` s; None: from its end."""
    recording = read_recording(path, with_samples=False)
    scenario, origin = resume(recording, time, recorded_span(path))
    return Choice(scenario, recording.name, origin, stands=True)


def recorded_span(path: Path) -> tuple[float, float]:
    """First and last instant of a recording, s. Raises `RecordingError` if it has no samples."""
    times = [(float(block.time[0]), float(block.time[-1])) for block in read_blocks(path)]
    if not times:
        raise RecordingError(f"{path.stem} has no samples.")
    return times[0][0], times[-1][1]


def export_into(path: Path, kind: str, start: float | None, end: float | None, folder: Path) -> Path:
    """Write a run, or a range of its time, into `folder`; returns the file. `kind`: csv, parquet or npz."""
    target = folder / f"{range_name(path, start, end)}.{kind}"
    return export_recording(read_recording(path, with_samples=False), target, start, end, read_blocks(path))


def archive_into(paths: tuple[Path, ...], kind: str, folder: Path) -> Path:
    """Write runs into one archive in `folder`, as they were recorded ("rrd", with their notes) or as tables; returns it."""
    target = folder / f"flexlab-{len(paths)}-runs.zip"
    # Recordings and tables are packed already, or large: packing them again would only make a visitor wait.
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED if kind == "csv" else zipfile.ZIP_STORED) as archive:
        for path in paths:
            if kind != "rrd":
                table = export_into(path, kind, None, None, folder)
                archive.write(table, table.name)
                table.unlink()
                continue
            archive.write(path, path.name)
            if is_regular(notes_path(path)):
                archive.write(notes_path(path), notes_path(path).name)
    return target


def range_name(path: Path, start: float | None, end: float | None) -> str:
    """What a file with this range of a run is called, without ending."""
    if start is None and end is None:
        return path.stem
    return f"{path.stem}-{'start' if start is None else f'{start:g}'}-to-{'end' if end is None else f'{end:g}'}-s"


def take_in(path: Path, logs: Path, notes: dict[str, str], quota: float | None) -> str:
    """Take an uploaded file into the library, note whose it is and measure it; returns the new run's id.

    `quota`: bytes that the owner's runs may take. Raises `RecordingError`, and takes nothing in, for what is over it.
    """
    owner = notes.get("owner", "")
    if refused := Quota(logs, owner, quota)(path.stat().st_size if path.suffix.lower() == SUFFIX else 0):
        raise RecordingError(refused)
    taken = import_into(path, logs, **notes)
    if refused := Quota(logs, owner, quota)():  # A table says how large its recording is only when that is there.
        remove_run(taken)
        raise RecordingError(f"{path.name} as a recording is too large: {refused}")
    note_metrics(taken)
    return taken.stem
