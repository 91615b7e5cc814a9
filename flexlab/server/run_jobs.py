"""Long work on runs: each function is one job for a process of its own.

When a visitor opens the library, a process at low priority measures runs that have no metrics yet.
"""

import asyncio
import time
import zipfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from flexlab.analysis.capsule import write_capsule
from flexlab.analysis.comparison import Table, compare
from flexlab.analysis.metrics.run_metrics import measured
from flexlab.analysis.replay import replay
from flexlab.analysis.resume import resume
from flexlab.analysis.run_summary import note_metrics, note_missing_metrics
from flexlab.errors import FlexlabError, RecordingError
from flexlab.files import is_regular, short_hash
from flexlab.recording.export import export_recording
from flexlab.recording.importing import import_into
from flexlab.recording.overlay import write_comparison
from flexlab.recording.reader import read_range, read_recording
from flexlab.recording.store.notes import notes_path, read_notes
from flexlab.recording.store.run_files import SUFFIX, check_own_recording, remove_run
from flexlab.recording.store.run_index import RunRow
from flexlab.scenario.field_text import field_title
from flexlab.server.labs import Choice
from flexlab.server.limits import LOOK, LOOK_AGAIN, PER_SECOND, Quota, Visitor
from flexlab.server.task_book import BAD, GOOD, Outcome, Task, TaskBook
from flexlab.server.tasks import Tasks
from flexlab.sim.pacing import FASTEST
from flexlab.text import visible

MOST_SAMPLES = 1_200_000
"""The longest run, in samples, that a job reads into memory at once: 20 minutes at the lab's rate, 0.6 GB."""
OVERLAY = "overlay.rrd"
"""Name of the overlay's file in the folder of a comparison."""
LONGEST_NUMBER = 20
"""Most characters of a number of samples quoted in a sentence."""
BYTES_OF_SAMPLE = 550
"""Approximate bytes of a sample in a recording, the only sign of its length while a run is being recorded."""
INDEXING = 0.05
"""The share of a comparison's work that comes after its last sample."""
UNSEEN = int(FASTEST * LOOK * PER_SECOND)
"""Approximate bytes that a lab records between two checks of its owner's quota."""
MOST_COMPARISONS = 8
"""Most comparisons that a server keeps: enough to go back and forth."""
MOST_REPLAYS = 200
"""Most replays that a server keeps."""


class ComparisonTables(NamedTuple):
    """The tables of a comparison's page, each with a row of heads first."""

    window: str
    """The range of time over which metrics are taken, in words."""
    metrics: Table
    settings: Table
    """The runs' values of each field in which they differ; the heads alone if there is none."""


def compare_runs(paths: tuple[Path, ...], folder: Path, report: Callable[[float], None]) -> Outcome:
    """Compare runs; the result is `ComparisonTables`, and their overlay is written into `folder`.

    `report` takes progress, 0 to 1.
    """
    for path in paths:
        check_size(path)
    lengths = [_noted_rows(path) or path.stat().st_size / BYTES_OF_SAMPLE for path in paths]
    shortest = min(lengths)
    # Longer runs are read once more, for the metrics of the range of time that all runs have.
    expected = 2 * sum(lengths) + shortest * sum(length > shortest for length in lengths)
    done = 0

    def seen(samples: int) -> None:
        nonlocal done
        done += samples
        report(min(done / expected, 1) * (1 - INDEXING))

    comparison = compare(paths, seen)
    folder.mkdir(exist_ok=True)
    write_comparison(comparison.recordings, folder / OVERLAY, comparison.text(), seen)
    scenarios = [recording.scenario for recording in comparison.recordings]
    heads, *settings = comparison.setting_table()
    titles = {"sample_period": "Sample period", "commands": "Changes during the run"}
    settings = [heads, *([titles.get(path) or field_title(path, *scenarios), *values] for path, *values in settings)]
    return Outcome(ComparisonTables(comparison.window_text, comparison.metric_table(), settings))


def check_size(path: Path) -> None:
    """Raise `RecordingError` for a run that is too long to be read into memory at once."""
    rows = _noted_rows(path)
    if rows > MOST_SAMPLES:
        shown = visible(rows, LONGEST_NUMBER)
        raise RecordingError(
            f"{path.stem} has {shown} samples, over {MOST_SAMPLES}: export a range of its time and import that first."
        )


def _noted_rows(path: Path) -> int:
    """The number of samples of a run by its notes; 0 if they do not say."""
    rows = read_notes(path).get("rows")
    return rows if type(rows) is int and rows > 0 else 0


def replay_run(path: Path, report: Callable[[float], None]) -> Outcome:
    """Replay a run and compare it with its recording; `report` takes progress, 0 to 1."""
    recording = read_recording(path)
    _, last = recording.span
    found = replay(recording, lambda time: report(time / last if last else 1.0))
    return Outcome(found.agrees, found.text, GOOD if found.agrees else BAD)


def choice_at(path: Path, time: float | None) -> Choice:
    """Return the choice with which a lab continues a run at `time`, s, or at its end if it is None."""
    recording = read_recording(path)
    scenario, origin = resume(recording, time)
    return Choice(scenario, recording.name, origin, stands=True)


def export_into(row: RunRow, kind: str, start: float | None, end: float | None, folder: Path) -> Path:
    """Write a run, or a range of its time, into `folder` and return the file.

    `kind`: a table (csv, parquet or npz) or Figures 2-5 in an archive (png or svg); for a whole run also one page (html) or an
    archive that others can verify (zip).
    """
    path, name = row.path, range_name(row.path, start, end)
    target = folder / f"{name}.{kind}"
    if kind in ("csv", "parquet", "npz"):
        return export_recording(read_recording(path), target, start, end)
    if start is None and end is None:
        check_size(path)
    if kind == "zip":
        write_capsule(path, target)
    elif kind == "html":
        from flexlab.study_api import write_page  # Only this job needs all studies.

        write_page(row, target)
    else:
        from flexlab.analysis.figures import paper_figures  # Only this job needs a drawing library.

        target = folder / f"{name}-figures-{kind}.zip"
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            for figure in paper_figures(read_range(path, start, end), folder, [kind], name):
                archive.write(figure, figure.name)
    return target


def archive_into(rows: tuple[RunRow, ...], kind: str, folder: Path) -> Path:
    """Write runs into one archive in `folder`, as recordings with their notes ("rrd") or as tables; return the file."""
    target = folder / f"flexlab-{len(rows)}-runs.zip"
    # Recordings and binary tables are compressed already: compressing them again would only take time.
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED if kind == "csv" else zipfile.ZIP_STORED) as archive:
        for row in rows:
            if kind != "rrd":
                table = export_into(row, kind, None, None, folder)
                archive.write(table, table.name)
                table.unlink()
                continue
            if row.path.exists():  # A pipe in its place would hold this task up.
                check_own_recording(row.path)
            archive.write(row.path, row.id + SUFFIX)  # An archive holds no name that is not text.
            if is_regular(notes_path(row.path)):
                archive.write(notes_path(row.path), f"{row.id}.json")
    return target


def range_name(path: Path, start: float | None, end: float | None) -> str:
    """The name, without extension, of a file with this range of a run."""
    if start is None and end is None:
        return path.stem
    return f"{path.stem}-{'start' if start is None else f'{start:g}'}-to-{'end' if end is None else f'{end:g}'}-s"


def take_in(path: Path, logs: Path, notes: dict[str, str], quota: float | None) -> str:
    """Import an uploaded file into the library, note its owner and measure it; return the new run's id.

    `quota`: most bytes of the owner's runs. Raises `RecordingError`, and imports nothing, if the run exceeds it.
    """
    owner = notes.get("owner", "")
    if refused := Quota(logs, owner, quota)(path.stat().st_size if path.suffix.lower() == SUFFIX else 0):
        raise RecordingError(refused)
    taken = import_into(path, logs, **notes)
    if Quota(logs, owner, quota)(UNSEEN):
        # The owner's lab may still be writing what it was granted before it saw this run.
        time.sleep(LOOK + LOOK_AGAIN)
    if refused := Quota(logs, owner, quota)():  # The recording of a table has a size only after the import.
        remove_run(taken)
        raise RecordingError(f"{path.name} as a recording is too large: {refused}")
    note_metrics(taken)
    return taken.stem


def comparison(book: TaskBook, asker: Visitor, rows: Sequence[RunRow]) -> Task:
    """Return the comparison of these runs, started if none is kept. Raises `BusyError`."""
    asked = tuple(row.id for row in rows)
    # A second visitor shares a running comparison even if a run that is being recorded has grown since.
    making = next((task.key for task in book.all() if task.working and task.about == asked), None)
    key = making or short_hash(repr([(row.id, row.size) for row in rows]))
    paths = tuple(row.path for row in rows)
    return book.start("Comparison", key, asker, compare_runs, paths, about=asked, anew=False)


def begin_replay(book: TaskBook, asker: Visitor, row: RunRow) -> None:
    """Start replaying a run, unless it is being replayed. Raises `BusyError`."""
    book.start("Replay", row.id, asker, replay_run, row.path, about=row.size)


def replay_of(book: TaskBook, row: RunRow) -> Task | None:
    """The replay of a run, if any. One that has ended counts only if the file is unchanged or the run is still growing."""
    task = book.get(row.id)
    known = task is not None and (task.working or task.about == row.size or row.state == "in use")
    return task if known else None


class Measuring:
    """The measuring of a server's runs, at most once at a time. For the server's event loop only."""

    def __init__(self, tasks: Tasks, logs: Path):
        self._tasks, self._logs = tasks, logs
        self._tried: set[str] = set()
        self._job: asyncio.Task[None] | None = None

    def look(self, rows: Sequence[RunRow]) -> int:
        """Start measuring if there are new runs to measure; return how many runs are still to be measured."""
        missing = {row.id for row in rows if not measured(row.metrics) and row.state in ("complete", "recovered")}
        if self._job is None or self._job.done():
            # A run that could not be measured is not tried again.
            if missing <= self._tried:
                return 0
            self._tried |= missing
            self._job = asyncio.create_task(self._measure())
        return len(missing)

    async def _measure(self) -> None:
        with suppress(FlexlabError, OSError):  # It is ended with the server, or the machine has too much to do.
            await self._tasks.run_unseen(note_missing_metrics, self._logs)
