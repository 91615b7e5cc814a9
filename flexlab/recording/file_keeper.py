"""Keeps one run going into a file: through folders that are not there yet, full disks and files that are taken away."""

import contextlib
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from flexlab.errors import RecordingError
from flexlab.recording.run_stream import RunStream, open_file_stream
from flexlab.recording.run_writer import RunWriter
from flexlab.recording.store.run_files import RunFile, claim_run_file, write_notes
from flexlab.sim.samples import Status

RETRY_PERIOD = 1.0
"""Wall seconds between attempts to open a file."""

ROOM_TO_RESUME = 32_000_000
"""Free bytes that a full disk must have again: a minute's worth, so that it is not full again at once."""


class FileKeeper:
    """The file of one run. What waits while a disk is full is written when there is room (see `rrd_file`)."""

    def __init__(self, logs: Path, run: RunWriter, tell: Callable[[str], None]):
        """Open the file; if that fails, `tell` gets a sentence, and `keep_up` tries again."""
        self._logs, self._run, self._tell = logs, run, tell
        self._file: RunFile | None = None
        self._stream: RunStream | None = None
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
        info = replace(self._run.info, part=self._parts + 1)
        file = claim_run_file(self._logs, info.name, info.started, info.part)
        try:
            stream = open_file_stream(file, info)
        except RecordingError:
            file.release()
            file.path.unlink(missing_ok=True)
            raise
        self._run.add_stream(stream)
        self._parts, self._file, self._stream, self._given_up = info.part, file, stream, 0
        self._recover(file)

    def _write(self, stream: RunStream, file: RunFile) -> None:
        self._check(stream, file)
        if self.problem is not None and _free_bytes(self._logs) < ROOM_TO_RESUME:
            stream.hold()
        else:
            stream.push()
            self._recover(file)

    def _check(self, stream: RunStream, file: RunFile) -> None:
        """Let go of a file that others have taken away, replaced or cut off. Raises `RecordingError`; a new part follows."""
        if file.in_place and stream.is_whole:
            return
        what = "changed by another program" if file.in_place else "replaced" if file.path.exists() else "taken away"
        self._run.drop_stream(stream)
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

    def end(self, status: Status, dropped: int) -> Path | None:
        """The run is over: close the file and return it, if there is one."""
        try:
            if self._stream is not None and self._file is not None:
                self._check(self._stream, self._file)
            self._run.end(status, dropped)
        except RecordingError as error:
            self._fail(str(error))
        file, self._file, self._stream = self._file, None, None
        if file is None:
            return None
        if self.problem is None:
            with contextlib.suppress(OSError):  # The recording is there; its state is then told from the file alone.
                write_notes(file.path, **self._run.summary(status, dropped))
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
