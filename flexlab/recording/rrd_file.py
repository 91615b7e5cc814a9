"""Appends a rerun stream to a file, and survives a full disk.

Rerun can write files itself, but when a disk is full its writer dies silently, all later data is lost, and letting go of it
may wait forever, even when the program ends. So rerun only encodes, into memory, and the bytes are written here: an error
is known at once, a half-written message is cut off again, and what could not be written waits until there is room.
"""

import os
import time
import zlib
from collections import deque
from collections.abc import Callable
from typing import IO

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.message_layout import messages

READING_SHARE = 0.05
"""Of the time that may go into reading a file again whose date somebody changed, or a network's clock."""
READ_BYTES = 1 << 20
"""Read at once."""
HELD_BYTES = 48_000_000
"""What waits for a full disk at most: one and a half minutes of the paper's run. Then the oldest is given up."""

Refusal = Callable[[int], str]
"""Says why so many more bytes may not be written; nothing if they may."""


def allow(size: int) -> str:
    """Any number of bytes."""
    return ""


class RrdFile:
    """A file that grows by whole messages. Not for use by two threads at once."""

    exact = True
    """Exact samples belong here."""

    def __init__(self, handle: IO[bytes], held_bytes: int = HELD_BYTES):
        """`handle`: a file open for writing, unbuffered, empty."""
        self._handle = handle
        self._held_bytes = held_bytes
        self._waiting: deque[bytes] = deque()
        self._waiting_bytes = 0
        self._size = self._checksum = 0
        self._date = os.fstat(handle.fileno()).st_mtime_ns
        self._next_reading = 0.0
        self._begun = False
        self.given_up = 0
        """Pieces that were given up because a disk stayed full for too long."""

    def hold(self, piece: bytes) -> None:
        """Take one piece as rerun encodes it, to be written by `write`. Raises `RecordingError` for what is none."""
        data = messages(piece, with_head=not self._begun)
        self._begun = True
        self._waiting.append(data)
        self._waiting_bytes += len(data)
        # The first piece has the head and says what the run is: without it the rest is worth nothing.
        oldest = 0 if self._size else 1
        while self._waiting_bytes > self._held_bytes and len(self._waiting) > oldest + 1:
            self._waiting_bytes -= len(self._waiting[oldest])
            del self._waiting[oldest]
            self.given_up += 1

    @property
    def is_whole(self) -> bool:
        """Whether the file still has exactly the bytes that were written: nobody cut it off or wrote over it."""
        found = os.fstat(self._handle.fileno())
        if found.st_size != self._size:
            return False
        if found.st_mtime_ns == self._date or time.monotonic() < self._next_reading:
            return True
        # Somebody wrote into it, or only touched it: its bytes tell.
        begun = time.monotonic()
        is_same = self._read_checksum() == self._checksum
        now = time.monotonic()
        self._next_reading = now + (now - begun) / READING_SHARE
        self._date = found.st_mtime_ns
        return is_same

    def _read_checksum(self) -> int:
        checksum = 0
        with open(self._handle.name, "rb", buffering=0) as file:
            while piece := file.read(READ_BYTES):
                checksum = zlib.crc32(piece, checksum)
        return checksum

    def write(self, refusal: Refusal = allow) -> None:
        """Write all that waits. Raises `RecordingError` if the disk or `refusal` does not take it; what is left waits on."""
        try:
            while self._waiting:
                if refused := refusal(len(self._waiting[0])):
                    raise RecordingError(refused)
                self._write(self._waiting[0])
                self._waiting_bytes -= len(self._waiting.popleft())
        except OSError as error:
            raise RecordingError(f"{self._handle.name} cannot be written ({error.strerror}).") from None

    def _write(self, data: bytes) -> None:
        """All or nothing: what was half written is cut off again."""
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._handle.fileno(), rest) :]
        except OSError:
            os.ftruncate(self._handle.fileno(), self._size)
            os.lseek(self._handle.fileno(), self._size, os.SEEK_SET)
            self._note_date()
            raise
        self._size += len(data)
        self._checksum = zlib.crc32(data, self._checksum)
        self._note_date()

    def _note_date(self) -> None:
        self._date = os.fstat(self._handle.fileno()).st_mtime_ns
