"""Keeps one run going into a file: through folders that are not there yet, full disks and files that are taken away."""

import contextlib
import shutil
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rerun as rr

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.chunks import Column
from flexlab.recording.run_encoder import Kept
from flexlab.recording.run_info import RunInfo
from flexlab.recording.run_stream import Refusal, RunStream, allow, open_file_stream
from flexlab.recording.store.notes import write_notes
from flexlab.recording.store.run_files import RunFile, claim_run_file
from flexlab.views import View

RETRY_PERIOD = 1.0
"""Wall seconds between attempts to open a file."""

ROOM_TO_RESUME = 32_000_000
"""Free bytes that a full disk must have again: a minute's worth, so that it is not full again at once."""

ROOM_TO_BEGIN = 1_000_000
"""Bytes that a run must be allowed before its file is begun: its layout and first second."""


class Sent(NamedTuple):
    """What a file that begins later is told again."""

    entity: str
    time: np.ndarray
    columns: list[Column]


class FileSink:
    """The file of one run. What waits while a disk is full is written when there is room (see `rrd_file`)."""

    def __init__(self, logs: Path, info: RunInfo, tell: Callable[[str], None], refusal: Refusal = allow):
        """Open the file; if that fails, `tell` gets a sentence, and `keep_up` tries again.

        `refusal` says why so many bytes may not be written just now, and nothing while they may.
        """
        self._logs, self._info, self._tell, self._refusal = logs, info, tell, refusal
        self._file: RunFile | None = None
        self._stream: RunStream | None = None
        self._past: list[Sent] = []
        self._present: dict[str, Sent] = {}
        self._curves: list[View] = []
        self._last_time = 0.0
        self._parts = 0
        self._given_up = 0
        self._next_try = 0.0
        self.problem: str | None = None
        """Why nothing reaches a file just now; None while all is well."""
        self.keep_up(0.0)

    @property
    def path(self) -> Path | None:
        """The file; None while there is none."""
        return None if self._file is None else self._file.path

    def send(
        self, entity: str, time: np.ndarray, columns: Iterable[Column], *, exact: bool = False, kept: Kept = "no"
    ) -> None:
        """Take columns for the instants `time` (N,), s; `keep_up` brings them into the file."""
        sent = Sent(entity, time, list(columns))
        self._last_time = max(self._last_time, float(time[-1]))
        if kept == "as it was":
            self._past.append(sent)
        elif kept == "as it stands":
            self._present[entity] = sent
        if self._stream is not None:
            self._stream.send(*sent, exact=exact)

    def name_curves(self, signals: Iterable[View]) -> None:
        """Take what the curves are called that will be sent, and how they look."""
        new = list(signals)
        self._curves += new
        if self._stream is not None:
            self._stream.name_curves(new)

    def send_property(self, name: str, values: rr.AsComponents) -> None:
        """Take a property, as seen in listings."""
        if self._stream is not None:
            self._stream.send_property(name, values)

    def keep_up(self, now: float) -> None:
        """Write what has come since the last call. `now`: wall time, s."""
        try:
            if self._stream is not None and self._file is not None:
                self._write(self._stream, self._file)
            elif now >= self._next_try:
                self._next_try = now + RETRY_PERIOD
                self._open()
        except RecordingError as error:
            self._fail(str(error))

    def _open(self) -> None:
        """Begin the run's next part. Raises `RecordingError`."""
        if self.problem is not None and _free_bytes(self._logs) < ROOM_TO_RESUME:
            return
        if refused := self._refusal(ROOM_TO_BEGIN):
            raise RecordingError(refused)
        info = replace(self._info, part=self._parts + 1)
        file = claim_run_file(self._logs, info.name, info.started, info.part)
        try:
            stream = open_file_stream(file, info)
        except RecordingError:
            file.release()
            file.path.unlink(missing_ok=True)
            raise
        self._tell_the_past(stream)
        self._parts, self._file, self._stream, self._given_up = info.part, file, stream, 0
        self._recover(file)
        if info.begin_notes:
            with contextlib.suppress(OSError):
                write_notes(file.path, **info.begin_notes)

    def _tell_the_past(self, stream: RunStream) -> None:
        """A part that begins later can then be replayed too."""
        stream.name_curves(self._curves)
        for sent in self._present.values():
            stream.send(sent.entity, np.full(len(sent.time), self._last_time), sent.columns)
        for sent in self._past:
            stream.send(*sent)

    def _write(self, stream: RunStream, file: RunFile) -> None:
        self._check(stream, file)
        if self.problem is not None and _free_bytes(self._logs) < ROOM_TO_RESUME:
            stream.hold()
        else:
            stream.push(self._refusal)
            self._recover(file)

    def _check(self, stream: RunStream, file: RunFile) -> None:
        """Let go of a file that others have taken away, replaced or changed. Raises `RecordingError`; a new part follows."""
        if file.in_place and stream.is_whole:
            return
        what = "changed by another program" if file.in_place else "replaced" if file.path.exists() else "taken away"
        stream.abandon()
        file.release()
        self._file = self._stream = None
        raise RecordingError(f"{file.path} was {what} while it was being written.")

    def _recover(self, file: RunFile) -> None:
        if self.problem is None:
            return
        self.problem = None
        lost = self._stream is not None and self._stream.given_up > self._given_up
        self._given_up = 0 if self._stream is None else self._stream.given_up
        self._tell(f"Recording goes on in {file.path.name}{'; a part of it is lost' if lost else ''}.")

    def _fail(self, reason: str) -> None:
        """Say what is wrong, once."""
        free = _free_bytes(self._logs)
        if free < ROOM_TO_RESUME:
            reason = f"The disk of {self._logs} is full ({free / 1e6:.1f} MB free)."
        told, self.problem = self.problem, f"{reason} This run is not being recorded until that is mended."
        if told is None:
            self._tell(self.problem)

    def close(self, notes: dict[str, Any]) -> Path | None:
        """The run is over: close the file, note beside it what is to be noted, and return it, if there is one."""
        try:
            if self._stream is not None and self._file is not None:
                self._check(self._stream, self._file)
            if self._stream is not None:
                self._stream.close(self._refusal)
        except RecordingError as error:
            self._fail(str(error))
        file, self._file, self._stream = self._file, None, None
        if file is None:
            return None
        if self.problem is None:
            with contextlib.suppress(OSError):  # The recording is there; its state is then told from the file alone.
                write_notes(file.path, **notes)
        file.release()
        return file.path


def _free_bytes(folder: Path) -> float:
    """Free bytes on the folder's disk; without a folder, of the nearest one above that is there."""
    for place in (folder, *folder.absolute().parents):
        try:
            return shutil.disk_usage(place).free
        except OSError:
            continue
    return float("inf")
