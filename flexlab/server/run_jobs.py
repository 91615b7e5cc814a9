"""Long work on runs: each function is one job in a process of its own, each class says of one server what came of them.

Comparisons are kept as files of the server's own, bounded, gone when it closes; replays as a sentence each; runs without metrics
are measured at low priority when somebody looks at the library.
"""

import asyncio
import contextlib
import hashlib
import io
import os
import zipfile
from collections import OrderedDict
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
from flexlab.errors import FlexlabError, RecordingError
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
from flexlab.server.labs.quota import Quota
from flexlab.server.limits import Asker
from flexlab.server.tasks import Tasks
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
MOST_BYTES = 1_000_000_000
"""Of all their files; the newest one is always kept."""


class Comparisons:
    """All comparisons of one server. For its event loop only."""

    def __init__(self, tasks: Tasks, folder: Path):
        """`folder`: where the overlays lie; somebody else removes it."""
        self._tasks, self._folder = tasks, folder
        self._made: OrderedDict[str, ComparisonTables] = OrderedDict()
        self._making: dict[tuple[str, ...], asyncio.Future[tuple[str, ComparisonTables]]] = {}

    async def get(self, asker: Asker, rows: Sequence[RunRow]) -> tuple[str, ComparisonTables]:
        """(id, tables) of the comparison of these runs, made if need be. Raises `FlexlabError` if they cannot be compared."""
        key = hashlib.sha256(repr([(row.id, row.size) for row in rows]).encode()).hexdigest()[:24]
        if key in self._made and self._path(key).exists():
            self._made.move_to_end(key)
            return key, self._made[key]
        asked = tuple(row.id for row in rows)
        if asked not in self._making:
            # Who asks meanwhile shares what this question starts, although a run that is being recorded has grown.
            self._making[asked] = asyncio.ensure_future(self._make(asker, key, rows))
            self._making[asked].add_done_callback(lambda _: self._making.pop(asked, None))
        return await asyncio.shield(self._making[asked])

    def file(self, key: str) -> Path | None:
        """The overlay; None if it is no more."""
        return self._path(key) if key in self._made else None

    async def _make(self, asker: Asker, key: str, rows: Sequence[RunRow]) -> tuple[str, ComparisonTables]:
        tables = await self._tasks.run(asker, compare_runs, tuple(row.path for row in rows), self._path(key))
        self._made[key] = tables
        await asyncio.to_thread(self._make_room)
        return key, tables

    def _make_room(self) -> None:
        while len(self._made) > 1 and (len(self._made) > MOST_COMPARISONS or self._bytes() > MOST_BYTES):
            key, _ = self._made.popitem(last=False)
            self._path(key).unlink(missing_ok=True)

    def _bytes(self) -> int:
        return sum(self._path(key).stat().st_size for key in self._made if self._path(key).exists())

    def _path(self, key: str) -> Path:
        return self._folder / f"comparison-{key}.rrd"


MOST_FINDINGS = 200
"""Findings that are remembered."""


@dataclass(frozen=True)
class ReplayState:
    """How the replay of one run stands."""

    working: bool
    sentence: str
    kind: str = ""
    """"good" or "bad" once it is over."""


class Replays:
    """All replays of one server, at most one at a time of each run. For its event loop only."""

    def __init__(self, tasks: Tasks):
        self._all = tasks
        self._states: OrderedDict[tuple[str, int], ReplayState] = OrderedDict()
        self._tasks: set[asyncio.Task[None]] = set()

    def start(self, asker: Asker, row: RunRow) -> None:
        """Replay a run, unless that is being done. Raises `BusyError`."""
        state = self.state(row)
        if state is not None and state.working:
            return
        self._all.check(asker)
        self._note(row, ReplayState(True, "Replay: waiting for its turn"))
        task = asyncio.create_task(self._replay(asker, row))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def state(self, row: RunRow) -> ReplayState | None:
        """How the run's replay stands; None if nobody asked for one since the file last changed."""
        return self._states.get(_key(row))

    async def _replay(self, asker: Asker, row: RunRow) -> None:
        def report(share: float) -> None:
            self._note(row, ReplayState(True, f"Replay: {100 * share:.0f} %"))

        try:
            agrees, text = await self._all.run(asker, replay_run, row.path, on_progress=report)
        except FlexlabError as error:
            self._note(row, ReplayState(False, f"Not replayed: {error}", "bad"))
        else:
            self._note(row, ReplayState(False, text, "good" if agrees else "bad"))

    def _note(self, row: RunRow, state: ReplayState) -> None:
        self._states[_key(row)] = state
        while len(self._states) > MOST_FINDINGS:
            self._states.popitem(last=False)


def _key(row: RunRow) -> tuple[str, int]:
    return row.id, row.size


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
