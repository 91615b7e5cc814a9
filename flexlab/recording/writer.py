"""The recorder: takes every sample and event of a running lab and writes one rerun file per run, on a thread of its own.

The simulation thread only puts references into a queue. What can go wrong with a disk is a sentence in `problem`, never an
exception in the lab; recording resumes by itself, in a new part of the run, as soon as it can.
"""

import contextlib
import queue
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from flexlab.errors import RecordingError
from flexlab.recording.blocks import join_blocks
from flexlab.recording.finisher import Finisher
from flexlab.recording.live import LiveHub
from flexlab.recording.run_files import RunFile, claim_run_file, write_notes
from flexlab.recording.run_info import RunInfo
from flexlab.recording.run_stream import RunStream, open_file_stream
from flexlab.recording.run_writer import RunWriter
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import TICK, Event
from flexlab.sim.world import WorldState

WRITE_PERIOD = 0.2
"""Wall seconds between writes: what a killed process loses at most, and some time for the write itself."""

CHECK_PERIOD = 0.5
"""Wall seconds between looks at whether the file takes what is written: rerun tells of a full disk only when asked."""

RETRY_PERIOD = 1.0
"""Wall seconds between attempts to go on with a file."""

ROOM_TO_RESUME = 32_000_000
"""Free bytes that a full disk must have again: a minute's worth, so that files do not fill up one by one."""

QUEUE_ROWS = 20_000
"""Samples (rows) that may wait: 20 s at real time, 12 MB; more are dropped and counted."""


class Recorder:
    """A consumer (see `sim.runner`) that records every run into `logs`, and sends it to `hub` if there is one."""

    def __init__(
        self,
        logs: Path,
        hub: LiveHub | None = None,
        on_problem: Callable[[str], None] | None = None,
        sample_period: float = TICK,
        queue_rows: int = QUEUE_ROWS,
    ):
        """Start the recorder's thread; nothing is written before a run begins.

        `on_problem` gets a sentence, on the recorder's thread, when recording fails and when it resumes.
        """
        self._logs, self._hub, self._on_problem = logs, hub, on_problem
        self._sample_period, self._queue_rows = sample_period, queue_rows
        self._queue: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._waiting_rows = 0
        self._dropped = 0
        self._problem: str | None = None
        self._run: RunWriter | None = None
        self._file: RunFile | None = None
        self._file_stream: RunStream | None = None
        self._parts = 0
        self._blocks: list[Samples] = []
        self._speeds: list[tuple[float, float]] = []
        self._next_write = self._next_check = self._next_try = 0.0
        self._finisher = Finisher(logs)
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str | None:
        """Why nothing is being recorded just now, as a sentence; None while all is well."""
        return self._problem

    @property
    def path(self) -> Path | None:
        """The file being written."""
        file = self._file
        return None if file is None else file.path

    @property
    def dropped_rows(self) -> int:
        """Samples of the present run that found the queue full."""
        return self._dropped

    # Called on the simulation thread: no disk, no waiting.

    def begin_run(self, run_number: int, name: str, scenario: Scenario, start: WorldState) -> None:
        """A new run starts."""
        self._dropped = 0
        info = RunInfo(name, scenario, self._sample_period, start)
        self._queue.put(lambda: self._begin(info))

    def take_samples(self, run_number: int, samples: Samples, actual_speed: float) -> int:
        """Queue a block of read-only samples; returns how many rows were dropped because the queue is full."""
        rows = len(samples)
        with self._lock:
            if self._waiting_rows + rows > self._queue_rows:
                self._dropped += rows
                return rows
            self._waiting_rows += rows
        self._queue.put(lambda: self._take(samples, actual_speed))
        return 0

    def take_event(self, run_number: int, event: Event) -> None:
        """Queue an event."""
        self._queue.put(lambda: self._note(event))

    def end_run(self, run_number: int, status: Status) -> None:
        """The run is over."""
        dropped = self._dropped
        self._queue.put(lambda: self._end(status, dropped))

    def close(self, finishing_time: float = 3.0) -> None:
        """Write what waits and stop; up to `finishing_time` s go into footers (the next start does what is left)."""
        self._queue.put(None)
        self._thread.join()
        self._finisher.close(finishing_time)

    # Everything below runs on the recorder's thread.

    def _work(self) -> None:
        while True:
            try:
                job = self._queue.get(timeout=WRITE_PERIOD)
            except queue.Empty:
                job = _nothing
            try:
                if job is None:
                    self._end(Status("finished", "The lab was closed."), self._dropped)
                    return
                job()
                self._keep_up()
            except Exception as error:  # The lab must go on whatever becomes of its recording.
                self._fail(f"The recorder stumbled ({type(error).__name__}: {error}).")
                if job is None:
                    return

    def _keep_up(self) -> None:
        now = time.monotonic()
        if now >= self._next_write:
            self._write()
            self._next_write = now + WRITE_PERIOD
        if now >= self._next_check:
            self._check()
            self._next_check = now + CHECK_PERIOD
        if self._run is not None and self._file_stream is None and now >= self._next_try:
            self._resume()
            self._next_try = now + RETRY_PERIOD

    def _begin(self, info: RunInfo) -> None:
        self._end(Status("finished", "A new run began."), self._dropped)
        self._run = RunWriter(info)
        self._problem, self._parts = None, 0
        if self._hub is not None:
            self._run.add_stream(self._hub.open_stream(info))
        try:
            self._open_file(self._run)
        except RecordingError as error:
            self._fail(str(error))

    def _take(self, samples: Samples, speed: float) -> None:
        self._blocks.append(samples)
        self._speeds.append((float(samples.time[-1]), speed))

    def _note(self, event: Event) -> None:
        if self._run is None:
            return
        if isinstance(event.command, ChangeScenario):
            self._write()  # What came before is drawn as it was then, and may have another mesh.
        self._run.write_event(event)

    def _write(self) -> None:
        blocks, speeds, self._blocks, self._speeds = self._blocks, self._speeds, [], []
        if blocks and self._run is not None:
            self._run.write_samples(join_blocks(blocks), *zip(*speeds, strict=True))
        with self._lock:
            self._waiting_rows -= sum(map(len, blocks))

    def _end(self, status: Status, dropped: int) -> None:
        run = self._run
        if run is None:
            return
        self._write()
        run.end(status, dropped)
        self._run, file, self._file, self._file_stream = None, self._file, None, None
        if file is not None:
            with contextlib.suppress(OSError):  # The recording is there; its state is then told from the file alone.
                write_notes(file.path, **run.summary(status, dropped))
            file.release()
            self._finisher.add(file.path)

    # Files that fail and come back.

    def _open_file(self, run: RunWriter) -> RunFile:
        """Begin the run's next part. Raises `RecordingError`."""
        info = replace(run.info, part=self._parts + 1)
        file = claim_run_file(self._logs, info.name, info.started, info.part)
        try:
            stream = open_file_stream(file.path, info)
        except RecordingError:
            file.release()
            file.path.unlink(missing_ok=True)
            raise
        run.add_stream(stream)
        self._parts, self._file, self._file_stream = info.part, file, stream
        return file

    def _check(self) -> None:
        if self._file_stream is None or self._file is None:
            return
        try:
            self._file_stream.flush()
            if not self._file.path.exists():
                raise RecordingError(f"{self._file.path} was removed while it was being written.")
        except RecordingError as error:
            self._fail(str(error))

    def _resume(self) -> None:
        run = self._run
        assert run is not None
        if _free_bytes(self._logs) < ROOM_TO_RESUME:
            return
        try:
            file = self._open_file(run)
        except RecordingError:
            return  # Said already; tried again soon.
        self._problem = None
        self._tell(f"Recording goes on in {file.path.name}.")

    def _fail(self, reason: str) -> None:
        """Go on without a file, and say so once."""
        file, stream, self._file, self._file_stream = self._file, self._file_stream, None, None
        if stream is not None and self._run is not None and stream in self._run.streams:
            self._run.drop_stream(stream)
        if file is not None:
            file.release()
        free = _free_bytes(self._logs)
        if free < ROOM_TO_RESUME:
            reason = f"The disk of {self._logs} is full ({free / 1e6:.1f} MB free)."
        told, self._problem = self._problem, f"{reason} This run is not being recorded until that is mended."
        if told is None:
            self._tell(self._problem)

    def _tell(self, text: str) -> None:
        if self._on_problem is not None:
            self._on_problem(text)


def _nothing() -> None:
    """What to do when nothing waits."""


def _free_bytes(folder: Path) -> float:
    """Free bytes on the folder's disk; without a folder, of the nearest one above that is there."""
    for place in (folder, *folder.absolute().parents):
        try:
            return shutil.disk_usage(place).free
        except OSError:
            continue
    return float("inf")
