"""Long work on runs: each function is one job in a process of its own.

Runs without metrics are measured at low priority when somebody looks at the library.
"""

import contextlib
import hashlib
import io
import os
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path

from flexlab.analysis.capsule import write_capsule
from flexlab.analysis.comparison import compare
from flexlab.analysis.metrics import MetricRow
from flexlab.analysis.metrics.run_metrics import measured
from flexlab.analysis.replay import replay
from flexlab.analysis.resume import resume
from flexlab.analysis.run_summary import note_metrics, note_missing_metrics
from flexlab.errors import RecordingError
from flexlab.recording.export import export_recording
from flexlab.recording.importing import import_into
from flexlab.recording.overlay import write_comparison
from flexlab.recording.reader import read_blocks, read_range, read_recording
from flexlab.recording.run_info import package_version
from flexlab.recording.store.notes import is_regular, notes_path, read_notes
from flexlab.recording.store.run_files import SUFFIX, remove_run
from flexlab.recording.store.run_index import RunRow
from flexlab.scenario.field_text import field_title
from flexlab.server.child_processes import end_with_the_server, failures_told_plainly, job_processes
from flexlab.server.labs.lab_provider import Choice
from flexlab.server.limits import Asker, Quota
from flexlab.server.task_book import BAD, GOOD, Outcome, Task, TaskBook
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


OVERLAY = "overlay.rrd"
"""In the folder of a comparison."""


def compare_runs(paths: tuple[Path, ...], folder: Path) -> Outcome:
    """Compare runs, as `ComparisonTables`, and write their overlay into `folder`."""
    for path in paths:
        check_size(path)
    comparison = compare(paths)
    folder.mkdir(exist_ok=True)
    write_comparison(comparison.recordings, folder / OVERLAY, comparison.text())
    scenarios = [recording.scenario for recording in comparison.recordings]
    settings = (SettingRow(field_title(path, *scenarios), values) for path, values in comparison.settings)
    return Outcome(ComparisonTables(comparison.window_text, comparison.metrics, tuple(settings)))


def check_size(path: Path) -> None:
    """Raises `RecordingError` for a run that does not fit into memory whole."""
    rows = read_notes(path).get("rows", 0)
    if isinstance(rows, int) and rows > MOST_SAMPLES:
        raise RecordingError(
            f"{path.stem} has {rows} samples, over {MOST_SAMPLES}: export a range of its time and import that first."
        )


def replay_run(path: Path, report: Callable[[float], None]) -> Outcome:
    """Whether a run comes out again, bit for bit; `report` is told how far it is, 0 to 1."""
    _, last = recorded_span(path)

    def blocks() -> Iterator[Samples]:
        for block in read_blocks(path):
            yield block
            report(float(block.time[-1]) / last if last else 1.0)

    found = replay(read_recording(path, with_samples=False), blocks())
    return Outcome(found.agrees, found.text, GOOD if found.agrees else BAD)


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


def whole_into(row: RunRow, kind: str, folder: Path) -> Path:
    """Write a whole run into `folder` as one page ("html") or as an archive that others can verify ("zip"); returns it."""
    check_size(row.path)
    target = folder / f"{row.path.stem}.{kind}"
    if kind == "zip":
        write_capsule(row.path, target)
        return target
    from flexlab.lab.run_page import Noted, write_run_page  # Other work need not wait for a library of drawing.

    recording = read_recording(row.path)
    noted = Noted(row.heading, row.note, row.lessons, row.changes)
    with contextlib.redirect_stdout(io.StringIO()):  # viser says where it serves, which it does for a moment only.
        write_run_page(recording.run, target, recording.name, package_version(), noted)
    return target


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


def figures_into(path: Path, kind: str, start: float | None, end: float | None, folder: Path) -> Path:
    """Draw Figures 2-5 of a run, or of a range of its time, into one file in `folder`. `kind`: png or svg."""
    from flexlab.analysis.figures import paper_figures  # Other work need not wait for a library of drawing.

    name = range_name(path, start, end)
    if start is None and end is None:
        check_size(path)
    target = folder / f"{name}-figures-{kind}.zip"
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for figure in paper_figures(read_range(path, start, end), folder, [kind], name=name):
            archive.write(figure, figure.name)
    return target


MOST_COMPARISONS = 8
"""Comparisons that are kept: enough to go back and forth."""


async def comparison(book: TaskBook, asker: Asker, rows: Sequence[RunRow]) -> Task:
    """The comparison of these runs, made if need be. Raises `FlexlabError` if they cannot be compared."""
    asked = tuple(row.id for row in rows)
    # Who asks meanwhile shares what the first question started, although a run that is being recorded has grown.
    making = next((task.key for task in book.all() if task.working and task.about == asked), None)
    key = making or hashlib.sha256(repr([(row.id, row.size) for row in rows]).encode()).hexdigest()[:24]
    paths = tuple(row.path for row in rows)
    return await book.finished("Comparison", key, asker, compare_runs, paths, about=asked)


MOST_REPLAYS = 200
"""Replays that are remembered."""


def replay_key(row: RunRow) -> str:
    """Names the replay of a run as its file is now."""
    return f"{row.id} {row.size}"


LOW_PRIORITY = 19
"""Unix niceness: the labs must not notice."""


@failures_told_plainly()
def measure(logs: Path) -> None:
    """The life of the measuring process."""
    end_with_the_server()
    with contextlib.suppress(AttributeError, OSError):
        os.nice(LOW_PRIORITY)
    with contextlib.suppress(KeyboardInterrupt):
        note_missing_metrics(logs)


class Measuring:
    """At most one such process of a server."""

    def __init__(self, logs: Path):
        self._logs = logs
        self._process: BaseProcess | None = None
        self._tried: set[str] = set()

    def look(self, rows: Sequence[RunRow]) -> int:
        """Start measuring if there is something new to measure; returns how many runs are still to be measured."""
        missing = {row.id for row in rows if not measured(row.metrics) and row.state in ("complete", "recovered")}
        if self._process is not None and self._process.is_alive():
            return len(missing)
        # What could not be measured once is not tried again at every look.
        if missing <= self._tried:
            return 0
        self._tried |= missing
        self._process = job_processes().Process(
            target=measure, args=(self._logs,), name="flexlab-measuring", daemon=True
        )
        self._process.start()
        return len(missing)

    def close(self) -> None:
        """End it; what is missing is measured another time."""
        if self._process is not None and self._process.is_alive():
            self._process.terminate()
            self._process.join()
