"""The file of one run while it is written, and a sink that survives missing folders, full disks and removed files."""

import contextlib
import os
import shutil
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from flexlab.errors import RecordingError
from flexlab.interrupts import put_off
from flexlab.recording.rerun_internals.chunks import PROPERTIES, Column
from flexlab.recording.rerun_internals.rrd_file import Pipe, Refusal, RefusedError, RrdFile, allow
from flexlab.recording.run_encoder import EVENTS, PATH, RECORDS, SAMPLES, RunStream
from flexlab.recording.run_info import GAPS, RunInfo, checked
from flexlab.recording.store.notes import write_notes
from flexlab.recording.store.run_files import BREAKS_OFF, RunFile, claim_run_file

RETRY_PERIOD = 1.0
"""Wall time between attempts to open a file, s."""
ROOM_TO_RESUME = 32_000_000
"""Free bytes that a full disk must have before recording resumes: a minute of data."""
SPACE_FULL = "The space of its visitor was full: what came later is not recorded."
DISK_FULL = "The disk was full: what came later is not recorded."
"""Reasons why a recording breaks off, for those who find it."""
ROOM_TO_BEGIN = 1_000_000
"""Bytes that must be allowed before a run's file is begun: its layout and first second."""


class RunWriter:
    """A claimed file and the stream that is written to it. Not for two threads at once."""

    def __init__(self, file: RunFile, info: RunInfo, in_one_piece: bool = False):
        """Begin the file with a description of the run.

        `in_one_piece`: where a named pipe can be made, rerun writes and finishes the file, which its tool then need not mend;
        only at the end is it known whether all of it is there. Raises `RecordingError`, and leaves no file, if that fails.
        """
        self.file = file
        self._bytes = RrdFile(file.handle)
        self._pipe = None
        undoing = contextlib.ExitStack()
        undoing.callback(file.path.unlink, missing_ok=True)
        undoing.callback(file.release)
        undoing.callback(self._end_pipe)
        try:
            with put_off():  # Of a stream that is only half set up, the pipe's end would never come.
                if in_one_piece and hasattr(os, "mkfifo"):
                    with contextlib.suppress(OSError):  # There may be no room for temporary files.
                        self._pipe = Pipe(file.handle)
                self.stream = RunStream(info, file=self._pipe and self._pipe.path)
                undoing.callback(self.stream.close)
            if self._pipe is None:
                self.push()
        except BaseException:
            undoing.close()
            raise

    is_lost = False
    """Whether `check` has given up the file: nothing can be written any more."""

    def check(self) -> None:
        """Give up a file that others have removed, replaced or changed, and raise `RecordingError`."""
        file = self.file
        if self.is_lost:
            raise RecordingError(f"{file.path} is not being written any more.")
        if file.in_place and (self._pipe is not None or self._bytes.is_whole):
            return
        self.is_lost = True
        what = "was taken away while it was being written"
        if file.in_place:
            what = "was changed by another program while it was being written"
        elif file.path.exists():
            what = "was replaced while it was being written"
        self.let_go()
        file.release()
        raise RecordingError(f"{file.path} {what}.")

    def push(self, refusal: Refusal = allow) -> None:
        """Write the data sent, as far as `refusal` allows; the rest waits for the next call. Raises `RecordingError`."""
        self.hold()
        self._bytes.write(refusal)

    def hold(self) -> None:
        """Keep the data sent for the next `push`, if the disk is known to be full. Raises `RecordingError`."""
        if piece := self.stream.read():
            self._bytes.hold(piece)

    @property
    def given_up(self) -> int:
        """Number of pieces of the recording that were lost to a full disk."""
        return self._bytes.given_up

    def close(self, refusal: Refusal = allow) -> None:
        """Write the rest; the claim stays until the file is released. Raises `RecordingError`."""
        try:
            self.push(refusal)
        finally:
            problem = self.let_go()
        if problem:
            raise RecordingError(f"{self.file.path} cannot be written ({problem.strerror}).")

    def let_go(self) -> OSError | None:
        """End the stream and drop unread data; return the error if a file in one piece lacks some of its data."""
        self.stream.close()
        return self._end_pipe()

    def _end_pipe(self) -> OSError | None:
        return None if self._pipe is None else self._pipe.close()


class FileSink:
    """The file of one run; data wait while the disk is full (see `rrd_file`)."""

    def __init__(self, logs: Path, info: RunInfo, tell: Callable[[str], None], refusal: Refusal = allow):
        """Open the file; if that fails, `tell` gets a sentence, and `keep_up` tries again. `refusal`: see `Refusal`."""
        self._logs, self._info, self._tell, self._refusal = logs, info, tell, refusal
        self._writer: RunWriter | None = None
        self._past: list[tuple[str, np.ndarray, list[Column]]] = []
        """Events sent so far, for a file that begins later."""
        self._path: list[Column] = []
        self._static: dict[str, rr.AsComponents] = {}
        self._last_time = 0.0
        self._parts = 0
        self._given_up = 0
        self._next_try = 0.0
        self._breaks_off = ""
        self._has_gaps = False
        self.problem: str | None = None
        """Why nothing reaches a file now; None while all is well."""
        self.keep_up(0.0)

    @property
    def path(self) -> Path | None:
        """The file; None while there is none."""
        return None if self._writer is None else self._writer.file.path

    def send(self, entity: str, time: np.ndarray, columns: Iterable[Column]) -> None:
        """Take columns for the instants `time` (N,), s; `keep_up` writes them to the file."""
        sent = entity, time, list(columns)
        self._last_time = max(self._last_time, float(time[-1]))
        if entity in (EVENTS, RECORDS):
            self._past.append(sent)
        elif entity == PATH:
            self._path = sent[2]
        if self._writer is not None:
            self._writer.stream.send(*sent)
        elif entity == SAMPLES:
            self._has_gaps = True

    def log(self, entity: str, archetype: rr.AsComponents) -> None:
        """Take data that hold at all times: a curve's appearance, or a property that listings show."""
        self._static[entity] = archetype
        if self._writer is not None:
            self._writer.stream.log(entity, archetype)

    def keep_up(self, now: float) -> None:
        """Write the data received since the last call. `now`: wall time, s."""
        try:
            if self._writer is not None:
                self._write(self._writer)
            elif now >= self._next_try:
                self._next_try = now + RETRY_PERIOD
                self._open()
        except RecordingError as error:
            self._fail(error)

    def _open(self) -> None:
        """Begin the run's next part. Raises `RecordingError`."""
        if self.problem is not None and _free_bytes(self._logs) < ROOM_TO_RESUME:
            return
        if refused := self._refusal(ROOM_TO_BEGIN):
            raise RefusedError(refused)
        info = replace(self._info, part=self._parts + 1)
        writer = RunWriter(claim_run_file(self._logs, info.name, info.started, info.part), info)
        # A later part is replayed by itself, so it needs all of this.
        for entity, archetype in self._static.items():
            writer.stream.log(entity, archetype)
        if self._path:
            writer.stream.send(PATH, np.array([self._last_time]), self._path)
        for sent in self._past:
            writer.stream.send(*sent)
        self._parts, self._writer, self._given_up = info.part, writer, 0
        self._recover(writer)
        if info.begin_notes:
            with contextlib.suppress(OSError):
                write_notes(writer.file.path, **info.begin_notes)

    def _write(self, writer: RunWriter) -> None:
        writer.check()
        if self.problem is not None and _free_bytes(self._logs) < ROOM_TO_RESUME:
            writer.hold()
        else:
            writer.push(self._refusal)
            self._recover(writer)

    def _recover(self, writer: RunWriter) -> None:
        if self.problem is None:
            return
        self.problem = None
        lost = writer.given_up > self._given_up
        self._given_up = writer.given_up
        self._tell(f"Recording goes on in {writer.file.path.name}{'; a part of it is lost' if lost else ''}.")

    def _fail(self, error: RecordingError) -> None:
        """Report an error once; a new part follows a file that is lost."""
        reason = str(error)
        self._breaks_off = SPACE_FULL if isinstance(error, RefusedError) else ""
        if self._writer is not None and self._writer.is_lost:
            self._writer = None
        free = _free_bytes(self._logs)
        if free < ROOM_TO_RESUME:
            reason = f"The disk of {self._logs} is full ({free / 1e6:.1f} MB free)."
            self._breaks_off = DISK_FULL
        told, self.problem = self.problem, f"{reason} This run is not being recorded until that is mended."
        if told is None:
            self._tell(self.problem)

    def close(self, notes: dict[str, Any]) -> Path | None:
        """Close the file at the end of a run, write notes beside it, and return its path, if there is one."""
        try:
            if self._writer is not None:
                self._writer.check()
                if self._has_gaps or self._parts > 1 or self._writer.given_up or self.problem is not None:
                    self._writer.stream.log(PROPERTIES + GAPS, rr.AnyValues(**checked({GAPS: 1})))
                self._writer.close(self._refusal)
                self.problem = None  # What waited has found room.
        except RecordingError as error:
            self._fail(error)
        writer, self._writer = self._writer, None
        if writer is None:
            return None
        file = writer.file
        if self.problem is not None:
            notes = {BREAKS_OFF: self._breaks_off} if self._breaks_off else {}
        if notes:
            with contextlib.suppress(OSError):  # The recording is there; its state is then told from the file alone.
                write_notes(file.path, **notes)
        file.release()
        return file.path


def _free_bytes(folder: Path) -> float:
    """Free bytes on the disk of a folder, or of the nearest folder above that exists."""
    for place in (folder, *folder.absolute().parents):
        try:
            return shutil.disk_usage(place).free
        except OSError:
            continue
    return float("inf")
