"""The live data of all runs, for rerun viewers that join at any time: the newest minutes of them, in memory.

Nothing listens here. The front server passes the bytes on at an address of its own, to whoever may come in there: a port of
rerun's would answer everybody on this machine.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.message_layout import HEAD, messages
from flexlab.recording.run_stream import Refusal, allow

MOST_BYTES = 64_000_000
"""What is kept for viewers that join late: about four minutes of the paper's run. What a run begins with stays."""

Take = Callable[[str, bytes], None]
"""Takes one piece of a run (its id, the bytes as rerun encodes them). Raises `RecordingError` once nobody takes any."""


@dataclass(frozen=True)
class Piece:
    """Some whole messages of one run."""

    number: int
    """Counted over all runs, from 0."""
    run: str
    data: bytes
    is_first: bool
    """It says what the run is, without which the others mean nothing."""


class LiveHub:
    """Keeps the newest pieces of all runs, until `close`. Any thread may use it."""

    def __init__(self, most_bytes: int = MOST_BYTES):
        self._most_bytes = most_bytes
        self._lock = threading.Lock()
        self._pieces: list[Piece] = []
        self._bytes = self._count = 0
        self._head = b""
        self._closed = False

    def take(self, run: str, piece: bytes) -> None:
        """One piece of a run as rerun encodes it. Raises `RecordingError` once the hub is closed."""
        data = messages(piece, with_head=False)
        with self._lock:
            if self._closed:
                raise RecordingError("The live stream is closed.")
            self._head = self._head or piece[:HEAD]
            is_first = not any(other.run == run for other in self._pieces)
            self._pieces.append(Piece(self._count, run, data, is_first))
            self._count += 1
            self._bytes += len(data)
            self._make_room()

    def _make_room(self) -> None:
        while self._bytes > self._most_bytes:
            oldest = next((piece for piece in self._pieces[:-1] if not self._is_needed(piece)), None)
            if oldest is None:
                return
            self._pieces.remove(oldest)
            self._bytes -= len(oldest.data)

    def _is_needed(self, piece: Piece) -> bool:
        return piece.is_first and any(other.run == piece.run and not other.is_first for other in self._pieces)

    def after(self, number: int) -> tuple[int, list[bytes]]:
        """(number of the newest piece, what came after piece `number`); from -1 on, all that is kept, as a rerun file."""
        with self._lock:
            found = [piece for piece in self._pieces if piece.number > number]
            if not found:
                return number, []
            head = [self._head] if number < 0 else []
            return found[-1].number, head + [piece.data for piece in found]

    @property
    def is_closed(self) -> bool:
        """Whether nothing comes any more."""
        return self._closed

    def close(self) -> None:
        """Let go of it all; viewers come to the end. May be called twice."""
        with self._lock:
            self._closed = True
            self._pieces.clear()


class LiveTarget:
    """Where the encoded messages of one run go that is watched live: as they come, to whoever takes them."""

    exact = False
    """Viewers have no use for exact samples."""
    given_up = 0
    is_whole = True

    def __init__(self, run: str, take: Take):
        self._run, self._take = run, take
        self._waiting: list[bytes] = []

    def hold(self, piece: bytes) -> None:
        """Take one piece as rerun encodes it, to be passed on by `write`."""
        self._waiting.append(piece)

    def write(self, refusal: Refusal = allow) -> None:
        """Pass on all that waits: it takes no room. Raises `RecordingError` once nobody takes it any more."""
        waiting, self._waiting = self._waiting, []
        for piece in waiting:
            self._take(self._run, piece)
