"""The recorder takes every sample and event of a running lab and writes one rerun file per run, on a thread of its own.

The simulation thread only puts references into a queue. Trouble with a disk becomes a sentence in `problem`, never an exception
in the lab; recording resumes by itself, in a new part of the run, as soon as it can.
"""

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from flexlab.errors import RecordingError
from flexlab.recording.file_sink import FileSink
from flexlab.recording.live import Take
from flexlab.recording.repair import Finisher
from flexlab.recording.rerun_internals.rrd_file import Refusal, allow
from flexlab.recording.run_encoder import RunEncoder, RunStream
from flexlab.recording.run_info import RunInfo, StartNotes
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Samples, Status, WorldState, join_blocks
from flexlab.sim.snapshot import TICK, Event

WRITE_PERIOD = 0.1
"""Wall time between writes of exact samples, s; a killed process loses as much."""
IDLE_PERIOD = 1.0
"""Wall time between checks that a file with nothing to write is there and has room, s."""
WRITE_ROWS = 200
"""Number of samples that are written even before `WRITE_PERIOD` has passed, as at four times real time."""
SHOW_PERIOD = 0.2
"""Wall time between writes of curves and shapes, s: each write costs a kilobyte per curve or shape."""
FINISHING_TIME = 1.5
"""Time for which closing waits for the footers of runs that have just ended, s: a lab closes within 3 s."""
QUEUE_ROWS = 20_000
"""Samples that may wait, 20 s at real time and 12 MB; more are dropped and counted."""


class Recorder:
    """A consumer (see `sim.snapshot`) that records every run into `logs`, and passes it to `live` if somebody watches."""

    def __init__(
        self,
        logs: Path,
        live: Take | None = None,
        on_problem: Callable[[str], None] | None = None,
        queue_rows: int = QUEUE_ROWS,
        start_notes: StartNotes | None = None,
        circumstances: Callable[[], Mapping[str, Any]] = dict,
        refusal: Refusal = allow,
    ):
        """Start the recorder's thread; nothing is written before a run begins.

        `on_problem` gets a sentence, on the recorder's thread, when recording fails and when it resumes. `start_notes` makes
        the notes for `RunEncoder`. `circumstances` returns notes on a run, written as it begins and again as it ends.
        `refusal`: see `Refusal`.
        """
        self._logs, self._live_to, self._on_problem = logs, live, on_problem
        self._queue_rows = queue_rows
        self._queue: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting_rows = 0
        self.dropped_rows = 0
        """Samples of the present run that found the queue full."""
        self._stumble: str | None = None
        self._run: RunEncoder | None = None
        self._file: FileSink | None = None
        self._live: RunStream | None = None
        self._blocks: list[Samples] = []
        self._unshown: list[Samples] = []
        self._speeds: list[tuple[float, float]] = []
        self._next_write = self._next_show = 0.0
        self._start_notes, self._circumstances, self._refusal = start_notes, circumstances, refusal
        self._finisher = Finisher(logs)
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str | None:
        """Why nothing is being recorded now, as a sentence; None while all is well."""
        file = self._file
        return self._stumble if file is None else file.problem or self._stumble

    @property
    def path(self) -> Path | None:
        """The file being written."""
        file = self._file
        return None if file is None else file.path

    # Called on the simulation thread: no disk, no waiting.

    def begin_run(self, run_number: int, name: str, scenario: Scenario, start: WorldState) -> None:
        """Begin a new run."""
        self.dropped_rows = 0
        info = RunInfo(name, scenario, TICK, start, begin_notes={"preset": name, **self._circumstances()})
        self._queue.put(lambda: self._begin(info))

    def take_samples(self, run_number: int, samples: Samples, actual_speed: float) -> int:
        """Queue a block of read-only samples, and return how many rows were dropped because the queue is full."""
        rows = len(samples)
        with self._lock:
            if self._waiting_rows + rows > self._queue_rows:
                self.dropped_rows += rows
                return rows
            self._waiting_rows += rows
        self._queue.put(lambda: self._take(samples, actual_speed))
        return 0

    def take_event(self, run_number: int, event: Event) -> None:
        """Queue an event."""
        self._queue.put(lambda: self._note(event))

    def end_run(self, run_number: int, status: Status) -> None:
        """End the run."""
        dropped = self.dropped_rows
        self._queue.put(lambda: self._end(status, dropped))

    def close(self, finishing_time: float = FINISHING_TIME) -> None:
        """Write all that is queued and stop, after up to `finishing_time` s for footers; the next start does the rest."""
        self._queue.put(None)
        self._thread.join()
        self._finisher.close(finishing_time)

    # Everything below runs on the recorder's thread.

    def _work(self) -> None:
        is_idle = False
        while True:
            try:
                job = self._queue.get(timeout=IDLE_PERIOD if is_idle else WRITE_PERIOD)
            except queue.Empty:
                job = _nothing
            waits = self._blocks or self._unshown or self._live is not None or self.problem is not None
            is_idle = job is _nothing and not waits
            try:
                if job is None:
                    self._end(Status("finished", "The lab was closed."), self.dropped_rows)
                    return
                job()
                self._keep_up()
            except Exception as error:  # The lab must go on whatever becomes of its recording.
                self._report(f"The recorder failed ({type(error).__name__}: {error}).")
                if job is None:
                    return

    def _keep_up(self) -> None:
        now = time.monotonic()
        if now >= self._next_write or sum(map(len, self._blocks)) >= WRITE_ROWS:
            self._next_write = now + WRITE_PERIOD
            self._write_exact()
            if now >= self._next_show:
                self._next_show = now + SHOW_PERIOD
                self._write_shown()
            if self._file is not None:
                self._file.keep_up(now)
            self._push_live()

    def _begin(self, info: RunInfo) -> None:
        self._end(Status("finished", "A new run began."), self.dropped_rows)
        self._live = self._open_live(info)
        file = FileSink(self._logs, info, self._tell, self._refusal)
        self._file, self._stumble = file, None
        sinks = [self._file] if self._live is None else [self._file, self._live]
        notes = None if self._start_notes is None else self._start_notes(info.name, info.scenario)
        self._run = RunEncoder(info, sinks, notes)

    def _open_live(self, info: RunInfo) -> RunStream | None:
        try:
            return None if self._live_to is None else RunStream(info, live=True)
        except RecordingError as error:
            self._report(str(error))
            return None

    def _push_live(self) -> None:
        try:
            if self._live is not None and self._live_to is not None and self._run is not None:
                if piece := self._live.read():
                    self._live_to(self._run.info.run_id, piece)
        except RecordingError as error:
            self._report(str(error))

    def _take(self, samples: Samples, speed: float) -> None:
        self._blocks.append(samples)
        self._speeds.append((float(samples.time[-1]), speed))

    def _note(self, event: Event) -> None:
        if self._run is None:
            return
        if isinstance(event.command, ChangeScenario):
            self._write()  # Earlier samples are drawn by the earlier scenario, and may have another mesh.
        self._run.write_event(event)

    def _write(self) -> None:
        self._write_exact()
        self._write_shown()

    def _write_exact(self) -> None:
        blocks, self._blocks = self._blocks, []
        try:
            if blocks and self._run is not None:
                samples = join_blocks(blocks)
                self._run.write_exact(samples)
                self._unshown.append(samples)
        finally:
            with self._lock:
                self._waiting_rows -= sum(map(len, blocks))

    def _write_shown(self) -> None:
        blocks, speeds, self._unshown, self._speeds = self._unshown, self._speeds, [], []
        if blocks and self._run is not None:
            self._run.write_shown(join_blocks(blocks), *zip(*speeds, strict=True))

    def _end(self, status: Status, dropped: int) -> None:
        run, file, live = self._run, self._file, self._live
        if run is None or file is None:
            return
        notes: dict[str, Any] = {}
        try:
            self._write()
            run.end(status, dropped)
            notes = {**self._circumstances(), **run.summary(status, dropped)}
        finally:  # Whatever fails, the file is closed, and the next run is recorded.
            path = file.close(notes)
            if live is not None:
                self._push_live()
                live.close()
            self._stumble = self.problem  # Until the next run has a file, or none.
            self._run = self._file = self._live = None
            if path is not None:
                self._finisher.add(path)

    def _report(self, text: str) -> None:
        """Report a problem that concerns no file, once, and keep it until the next run."""
        said, self._stumble = self._stumble, text
        if said is None:
            self._tell(text)

    def _tell(self, text: str) -> None:
        if self._on_problem is not None:
            with contextlib.suppress(Exception):  # A broken listener must not stop the recording.
                self._on_problem(text)


def _nothing() -> None:
    """The job when nothing waits."""
