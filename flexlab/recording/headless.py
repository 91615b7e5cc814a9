"""Recording without a screen: the simulation waits for its recorder, so nothing is ever dropped."""

import contextlib
import os
from collections.abc import Iterable, Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from flexlab.errors import RecordingError
from flexlab.interrupts import put_off
from flexlab.recording.course import Course
from flexlab.recording.file_sink import RunWriter
from flexlab.recording.reader import Recording
from flexlab.recording.repair import finish, note_sound
from flexlab.recording.run_encoder import RunEncoder, is_end
from flexlab.recording.run_info import RunInfo, RunNotes, makers
from flexlab.recording.store.notes import write_notes
from flexlab.recording.store.run_files import (
    BREAKING_OFF,
    BREAKS_OFF,
    SUFFIX,
    claim_named_file,
    claim_run_file,
    remove_run,
)
from flexlab.sim.samples import MEASURED, Run, Samples, Status
from flexlab.sim.snapshot import TICK, Event

BLOCK_ROWS = 20_000
"""Samples per block of a run that is in memory: larger blocks make smaller files."""
LARGE_ROWS = 2000
"""Samples in a block that need not be joined with others; joining reads the whole recording into memory."""


class HeadlessRecording:
    """The recording of one run, written on the caller's own thread, as a context manager.

    All methods raise `RecordingError` if the folder cannot be written or its disk is full.
    """

    def __init__(self, logs: Path, info: RunInfo, notes: RunNotes | None = None, in_one_piece: bool = False):
        """Create `logs/<time>-<name>.rrd`, or `logs` itself if it is called `….rrd`.

        `notes` as for `RunEncoder`, `in_one_piece` as for `RunWriter`.
        """
        is_named = logs.suffix == SUFFIX and not os.path.isdir(logs)
        file = claim_named_file(logs) if is_named else claim_run_file(logs, info.name, info.started)
        self.path: Path = file.path
        """The file."""
        self._status: Status | None = None
        self._goal: float | None = None
        """Last instant of the run that `write_whole` writes, s."""
        self._safe: float | None = None
        self._blocks = 0
        self._in_one_piece = in_one_piece
        with self._telling():
            self._writer = RunWriter(file, info, in_one_piece)
        self._run = RunEncoder(info, [self._writer.stream], notes)

    def write(self, samples: Samples) -> None:
        """Write the next block (N >= 1)."""
        with put_off(), self._telling():
            self._writer.check()
            self._run.write_samples(samples)
            self._blocks += 1
            if not self._in_one_piece:
                self._writer.push()
                self._safe = self._run.last_time

    def note(self, event: Event) -> None:
        """Write an event; commands belong here too, so that the run can be replayed."""
        if not self._writer.is_lost:
            with put_off():
                self._run.write_event(event)

    def write_whole(self, run: Run, events: Iterable[Event] = ()) -> None:
        """Write a run with its events in order, as a change of the scenario affects the drawing of later samples."""
        first, self._goal = 0, float(run.time[-1]) if len(run) else 0.0
        for event in chain(events, [None]):
            end = len(run) if event is None else int(np.searchsorted(run.time, event.time, "right"))
            for start in range(first, end, BLOCK_ROWS):
                self.write(run.slice(start, min(start + BLOCK_ROWS, end)))
            first = max(first, end)
            if event is not None:
                self.note(event)
        self.end(run.status)

    def end(self, status: Status) -> None:
        """Set how the run ended."""
        self._status = status

    def __enter__(self) -> "HeadlessRecording":
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        """Close and finish the file; an interrupted run keeps what was written."""
        writer = self._writer
        if writer.is_lost:  # Others have changed the file: what is left of it is made whole.
            with contextlib.suppress(RecordingError):
                finish(self.path)
            return
        status = self._status or self._early_end()
        breaks_off = {BREAKS_OFF: status.text} if status == BREAKING_OFF else {}
        lost = (isinstance(error, RecordingError) and self._safe is None) or (bool(breaks_off) and not self._run.rows)
        try:
            with put_off():
                with self._telling():
                    self._run.end(status)
                    if lost:
                        writer.let_go()
                    else:
                        writer.close()
                if not lost:
                    # Without notes, the recording's state is told from the file alone.
                    with contextlib.suppress(OSError):
                        write_notes(self.path, **self._run.summary(status, dropped=0), **breaks_off)
        except RecordingError:
            lost = self._safe is None
            raise
        finally:
            is_own = writer.file.in_place
            writer.file.release()
            if lost and is_own:  # Nothing of the run is in it.
                with contextlib.suppress(RecordingError):
                    remove_run(self.path)
        if not lost:
            with contextlib.suppress(RecordingError):  # Finishing needs room; all of the run is there.
                finish(self.path, join=self._run.rows < LARGE_ROWS * self._blocks)
                note_sound(self.path)

    def _early_end(self) -> Status:
        """How a recording ends that was interrupted: its run stopped then, unless it had been computed before."""
        last = self._run.last_time
        if self._goal is None:
            return Status("finished", f"Stopped at t = {last:g} s.", last)
        said = f"the run goes on to t = {self._goal:g} s, but is recorded up to t = {last:g} s only."
        return Status(BREAKING_OFF, f"Saving was interrupted: {said}", last)

    @contextlib.contextmanager
    def _telling(self) -> Iterator[None]:
        """Add to an error what was saved before it."""
        try:
            yield
        except RecordingError as error:
            saved = "nothing of the run is recorded"
            if self._safe is not None and not self._writer.is_lost:
                saved = f"the run is recorded up to t = {self._safe:g} s"
            raise RecordingError(f"{error} Make room, or choose another folder: {saved}.") from None


def write_run(run: Run, logs: Path, name: str, notes: RunNotes | None = None, course: Course | None = None) -> Path:
    """Record a finished `Run` and return its path; `logs` and `notes` as for `HeadlessRecording`.

    `course`: None for a run from its scenario's start without any command. Raises `RecordingError`.
    """
    if course is None:
        course = Course(float(run.time[1] - run.time[0]) if len(run) > 1 else TICK)
    measured = run.status.text if run.status == MEASURED else ""
    made = {"measured": measured, "recorded_by": course.recorded_by}
    info = RunInfo(name, run.scenario, course.sample_period, course.start, **made)
    with HeadlessRecording(logs, info, notes, in_one_piece=True) as recording:
        recording.write_whole(run, course.events)
    return recording.path


def course_of_recording(recording: Recording) -> Course:
    """The course of a recorded run, to record it again."""
    events = tuple(event for event in recording.events if not is_end(event))
    return Course(recording.sample_period, events, recording.start, makers(recording.properties, recording.computed_in))
