"""The newest minutes of all runs in memory, for rerun viewers that join at any time.

No port is opened here. The front server passes the bytes on to visitors with access; a port of rerun's own would answer
everybody on this machine.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.rrd_file import HEAD, messages

MOST_BYTES = 64_000_000
"""Bytes kept for viewers that join late: about four minutes of the paper's run, and the beginning of each run."""
Take = Callable[[str, bytes], None]
"""Takes one piece of a run (its id, the bytes as rerun encodes them). Raises `RecordingError` once no more are taken."""


@dataclass(frozen=True)
class Piece:
    """Some whole messages of one run."""

    number: int
    """Counted over all runs, from 0."""
    run: str
    data: bytes
    is_first: bool
    """Whether it describes the run; the other pieces need it."""


class LiveHub:
    """Keeps the newest pieces of all runs, until `close`. Any thread may use it."""

    def __init__(self, most_bytes: int = MOST_BYTES):
        self._most_bytes = most_bytes
        self._lock = threading.Lock()
        self._pieces: list[Piece] = []
        self._bytes = self._count = 0
        self._head = b""
        self.is_closed = False

    def take(self, run: str, piece: bytes) -> None:
        """Take one piece of a run as rerun encodes it. Raises `RecordingError` once the hub is closed."""
        data = messages(piece, with_head=False)
        with self._lock:
            if self.is_closed:
                raise RecordingError("The live stream is closed.")
            self._head = self._head or piece[:HEAD]
            is_first = not any(other.run == run for other in self._pieces)
            self._pieces.append(Piece(self._count, run, data, is_first))
            self._count += 1
            self._bytes += len(data)
            self._make_room()

    def _make_room(self) -> None:
        while self._bytes > self._most_bytes:
            going_on = {piece.run for piece in self._pieces if not piece.is_first}
            usable = (piece for piece in self._pieces[:-1] if not (piece.is_first and piece.run in going_on))
            oldest = next(usable, None)
            if oldest is None:
                return
            self._pieces.remove(oldest)
            self._bytes -= len(oldest.data)

    def after(self, number: int) -> tuple[int, list[bytes]]:
        """(number of the newest piece, the pieces after `number`); for -1 all pieces kept, as a rerun file."""
        with self._lock:
            found = [piece for piece in self._pieces if piece.number > number]
            if not found:
                return number, []
            head = [self._head] if number < 0 else []
            return found[-1].number, head + [piece.data for piece in found]

    def close(self) -> None:
        """Drop all pieces; viewers see the end. May be called twice."""
        with self._lock:
            self.is_closed = True
            self._pieces.clear()
