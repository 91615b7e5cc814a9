"""A thread that finishes recordings one after another, while the lab runs."""

import contextlib
import queue
import threading
from pathlib import Path

from flexlab.errors import RecordingError
from flexlab.recording.repair import Mending, finish, finish_abandoned


class Finisher:
    """Finishes files as they are added, after those that an earlier lab left behind in `logs`."""

    def __init__(self, logs: Path):
        self._queue: queue.SimpleQueue[Path | None] = queue.SimpleQueue()
        self._mending = Mending()
        self._thread = threading.Thread(target=self._work, args=(logs,), name="finisher", daemon=True)
        self._thread.start()

    def add(self, path: Path) -> None:
        """Finish this file soon."""
        self._queue.put(path)

    def close(self, patience: float) -> None:
        """Stop when all is done, or after `patience` s; what is left keeps for the next start."""
        self._queue.put(None)
        self._thread.join(patience)
        self._mending.stop()
        self._thread.join()

    def _work(self, logs: Path) -> None:
        finish_abandoned(logs, self._mending)
        while (path := self._queue.get()) is not None:
            self._finish(path)

    def _finish(self, path: Path) -> None:
        # A file that cannot be finished keeps what it has; `run_state` tells.
        with contextlib.suppress(RecordingError, OSError):
            if not self._mending.stopped:
                finish(path, self._mending)
