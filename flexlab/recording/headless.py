"""Recording without a screen: the simulation waits for its recorder, so nothing is ever dropped."""

import contextlib
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from types import TracebackType

from flexlab.errors import RecordingError
from flexlab.recording.repair import finish
from flexlab.recording.run_encoder import RunEncoder
from flexlab.recording.run_info import RunInfo, StartNotes
from flexlab.recording.run_stream import RunStream, open_file_stream
from flexlab.recording.store.notes import write_notes
from flexlab.recording.store.run_files import SUFFIX, claim_named_file, claim_run_file, remove_run
from flexlab.sim.samples import Run, Samples, Status
from flexlab.sim.snapshot import TICK, Event

BLOCK_ROWS = 10_000
"""Samples per block of a run that is there already: large ones are written sooner, and make small files."""

LARGE_ROWS = 2000
"""Samples of a block that need not be joined with others, which takes the whole recording into memory."""


class HeadlessRecording:
    """The recording of one run, written on the caller's own thread, as a context manager.

    All methods raise `RecordingError` if the folder cannot be written or its disk is full.
    """

    def __init__(self, logs: Path, info: RunInfo, start_notes: StartNotes | None = None):
        """Create `logs/<time>-<name>.rrd`, or `logs` itself if it is called `….rrd`; `start_notes` as for `RunEncoder`."""
        is_named = logs.suffix == SUFFIX and not logs.is_dir()
        self._file = claim_named_file(logs) if is_named else claim_run_file(logs, info.name, info.started)
        self._status: Status | None = None
        self._safe: float | None = None
        self._blocks = 0
        self._stream: RunStream | None = None
        try:
            self._stream = open_file_stream(self._file, info)
        except BaseException:
            self._file.release()
            self._file.path.unlink(missing_ok=True)
            raise
        self._sinks = [self._stream]
        self._run = RunEncoder(info, self._sinks, start_notes)

    @property
    def path(self) -> Path:
        """The file."""
        return self._file.path

    def write(self, samples: Samples) -> None:
        """Write the next block (N >= 1)."""
        with self._telling():
            if self._stream is None or not (self._file.in_place and self._stream.is_whole):
                self._safe = None
                self._let_go()
                raise RecordingError(f"{self.path} was changed or taken away while it was being written.")
            self._run.write_samples(samples)
            self._blocks += 1
            self._stream.push()
            self._safe = self._run.last_time

    def note(self, event: Event) -> None:
        """Write an event; commands belong here too, so that the run can be replayed."""
        self._run.write_event(event)

    def end(self, status: Status) -> None:
        """Say how the run ended."""
        self._status = status

    def __enter__(self) -> "HeadlessRecording":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close and finish the file; of an interrupted run, what there is of it."""
        status = self._status or Status("finished", f"Stopped at t = {self._run.last_time:g} s.", self._run.last_time)
        if isinstance(error, RecordingError) and self._safe is None:
            self._drop()
            return
        try:
            with self._telling():
                self._run.end(status)
                if self._stream is not None:
                    self._stream.close()
            write_notes(self.path, **self._run.summary(status, dropped=0))
        except OSError:
            pass  # The recording is there; its state is then told from the file alone.
        except RecordingError:
            if self._safe is None:
                self._drop()
            raise
        finally:
            self._file.release()
        with contextlib.suppress(RecordingError):  # What is left to do needs room; all of the run is there.
            finish(self.path, join=self._run.rows < LARGE_ROWS * self._blocks)

    def _drop(self) -> None:
        """Remove what a full disk left of the file, unless it is somebody else's by now: nothing of a run is in it."""
        is_own = self._stream is not None and self._file.in_place
        self._let_go()
        self._file.release()
        if is_own:
            with contextlib.suppress(RecordingError):
                remove_run(self.path)

    def _let_go(self) -> None:
        if self._stream is not None:
            self._stream.abandon()
        self._stream = None
        self._sinks.clear()

    @contextlib.contextmanager
    def _telling(self) -> Iterator[None]:
        """Say with an error what was saved before it."""
        try:
            yield
        except RecordingError as error:
            raise RecordingError(f"{error} Make room, or choose another folder: {self._saved()}.") from None

    def _saved(self) -> str:
        return (
            "nothing of the run is recorded"
            if self._safe is None
            else f"the run is recorded up to t = {self._safe:g} s"
        )


def write_run(
    run: Run, logs: Path, name: str, started: datetime | None = None, start_notes: StartNotes | None = None
) -> Path:
    """Record a finished `Run` and return its path; `logs` and `start_notes` as for `HeadlessRecording`.

    Raises `RecordingError`.
    """
    period = float(run.time[1] - run.time[0]) if len(run) > 1 else TICK
    info = RunInfo(name, run.scenario, period)
    if started is not None:
        info = RunInfo(name, run.scenario, period, started=started)
    with HeadlessRecording(logs, info, start_notes) as recording:
        for first in range(0, len(run), BLOCK_ROWS):
            recording.write(run.slice(first, min(first + BLOCK_ROWS, len(run))))
        recording.end(run.status)
    return recording.path
