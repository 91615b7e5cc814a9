"""The layout of a rerun file, and a file that is being written.

Each piece that rerun encodes is a small file of its own: a head, messages (kind and length, 8 bytes each, then the body), an
end message with an index, and a foot. A larger file is one head and the messages of all pieces; `repair` adds the end.

Rerun can write files itself, but when a disk is full its writer dies silently, all later data are lost, and a flush waits for
ever. So rerun only encodes, and the bytes are written here. A run that goes on is encoded into memory: an error is known at once,
a half-written message is cut off again, and what could not be written waits until there is room. A run that is over is encoded
as a finished file into a pipe, so that memory holds no copy of it.
"""

import contextlib
import os
import shutil
import struct
import sys
import tempfile
import threading
import time
import zlib
from collections import deque
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import IO

from flexlab.errors import RecordingError
from flexlab.text import visible

if sys.platform == "linux":
    import fcntl

MAGIC = b"RRF2"
"""First bytes of a rerun file of this generation."""
HEAD = 12
"""Bytes of the head: magic, version, options."""
MESSAGE = struct.Struct("<QQ")
"""Kind and length of a message's body."""
END = 0
"""Kind of the end message."""
FAMILY = b"RRF"
"""First bytes of a rerun file of any version."""
FOOTER, FOOTER_PLACE = b"RRF2FOOT", 12
"""Beginning and number of the last bytes of a finished file."""


def messages(piece: bytes, with_head: bool) -> bytes:
    """A piece without its end and foot, and without its head unless `with_head`."""
    if piece[: len(MAGIC)] != MAGIC:
        raise RecordingError(f"Rerun encodes as {piece[:4]!r}, not {MAGIC!r}: this flexlab needs rerun-sdk 0.41.")
    place = HEAD
    while place < len(piece):
        kind, length = MESSAGE.unpack_from(piece, place)
        if kind == END:
            break
        place += MESSAGE.size + length
    return piece[0 if with_head else HEAD : place]


def check_path(path: Path) -> None:
    """Raise `RecordingError` for a path that rerun cannot open: one that is not text in UTF-8."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise RecordingError(
            f"{visible(path)} has bytes in its name that are not UTF-8, and rerun opens no such file: rename it."
        ) from None


def has_footer(path: Path) -> bool:
    """Whether the file ends as a finished rerun file does."""
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - FOOTER_PLACE))
        return file.read().startswith(FOOTER)


READING_SHARE = 0.05
"""Largest share of the time that goes into reading a file again after its date has changed."""
READ_BYTES = 1 << 20
"""Number of bytes that are read at once, and that a pipe holds where its size can be set."""
HELD_BYTES = 48_000_000
"""Largest number of bytes that wait for room: one and a half minutes of the paper's run. Beyond it the oldest are given up."""


class Pipe:
    """A named pipe into which rerun writes a file; a thread passes it on, and reads on when the disk takes no more."""

    def __init__(self, handle: IO[bytes]):
        """`handle`: the file, open for writing, unbuffered. Raises OSError."""
        self._folder = tempfile.mkdtemp(prefix="flexlab-pipe-")
        self.path = Path(self._folder) / "run.rrd"
        """The path to which rerun writes."""
        try:
            os.mkfifo(self.path)
        except OSError:
            os.rmdir(self._folder)
            raise
        self._problem: OSError | None = None
        # Held open: if rerun failed before it opened its end, the reader would wait for it.
        self._end = os.open(self.path, os.O_RDWR | os.O_NONBLOCK)
        if sys.platform == "linux":
            with contextlib.suppress(OSError):  # A user's pipes may hold only so much: then it stays smaller.
                fcntl.fcntl(self._end, fcntl.F_SETPIPE_SZ, READ_BYTES)
        # The thread allocates nothing: without memory it would end, and rerun would wait for it for ever.
        piece = memoryview(bytearray(READ_BYTES))
        source = self.path.open("rb", buffering=0)
        arguments = source, handle, piece
        self._thread = threading.Thread(target=self._pass_on, args=arguments, name="flexlab-pipe", daemon=True)
        try:
            self._thread.start()
        except RuntimeError as error:  # The script is ending, or the system lets no more threads begin.
            source.close()
            os.close(self._end)
            shutil.rmtree(self._folder, ignore_errors=True)
            raise OSError(str(error)) from None

    def _pass_on(self, source: FileIO, handle: IO[bytes], piece: memoryview) -> None:
        with source:
            while size := source.readinto(piece):
                rest = piece[:size]
                try:
                    while rest and self._problem is None:
                        rest = rest[os.write(handle.fileno(), rest) :]
                except OSError as error:
                    self._problem = error

    def close(self) -> OSError | None:
        """Wait for the rest of the data, after rerun has closed its end; return the error if the file lacks some of them."""
        os.close(self._end)
        self._thread.join()
        shutil.rmtree(self._folder, ignore_errors=True)
        return self._problem


Refusal = Callable[[int], str]
"""Returns why so many more bytes may not be written, or "" if they may."""


def allow(size: int) -> str:
    """Allow any number of bytes."""
    return ""


class RefusedError(RecordingError):
    """A `Refusal` does not let more bytes be written."""


class RrdFile:
    """A file that grows by whole messages. Not for use by two threads at once."""

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
        """Number of pieces that were given up because a disk stayed full for too long."""

    def hold(self, piece: bytes) -> None:
        """Take one piece as rerun encodes it, to be written by `write`. Raises `RecordingError` for anything else."""
        data = messages(piece, with_head=not self._begun)
        self._begun = True
        self._waiting.append(data)
        self._waiting_bytes += len(data)
        # The first piece has the head and describes the run: without it the rest is useless.
        oldest = 0 if self._size else 1
        while self._waiting_bytes > self._held_bytes and len(self._waiting) > oldest + 1:
            self._waiting_bytes -= len(self._waiting[oldest])
            del self._waiting[oldest]
            self.given_up += 1

    @property
    def is_whole(self) -> bool:
        """Whether the file still has exactly the bytes that were written: nobody has truncated or overwritten it."""
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
        """Write all waiting pieces. Raises `RecordingError` if the disk is full or `refusal` refuses; the rest waits on."""
        try:
            while self._waiting:
                if refused := refusal(len(self._waiting[0])):
                    raise RefusedError(refused)
                self._write(self._waiting[0])
                self._waiting_bytes -= len(self._waiting.popleft())
        except OSError as error:
            raise RecordingError(f"{self._handle.name} cannot be written ({error.strerror}).") from None

    def _write(self, data: bytes) -> None:
        """Write all or nothing: half-written data are cut off again."""
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
