"""How long threads had to wait for a core: what others did to a measurement on a shared machine (Linux)."""

import threading
import time
from dataclasses import dataclass
from pathlib import Path

LOOK_EVERY = 0.005
"""s between two looks: threads that end are remembered as last seen."""


@dataclass
class _Life:
    first_seen: float
    first_waited: float
    last_seen: float
    last_waited: float

    @property
    def undisturbed(self) -> float:
        """Life of the thread less its time in the queue for a core, s."""
        return (self.last_seen - self.first_seen) - (self.last_waited - self.first_waited)


class ThreadWatch:
    """Watches this process's threads with a name prefix while a `with` block runs."""

    def __init__(self, prefix: str):
        self._prefix = prefix
        self._lives: dict[int, _Life] = {}
        self._ended = threading.Event()
        self._watcher = threading.Thread(target=self._watch, name="thread-watch", daemon=True)

    def __enter__(self) -> "ThreadWatch":
        self._watcher.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._watcher.join()

    @property
    def undisturbed(self) -> float | None:
        """Wall time that the slowest thread would have needed with a core of its own, s; None where it is not known.

        Cautious: a thread that waits for a lock whose owner waits for a core counts as waiting for the lock.
        """
        return max((life.undisturbed for life in self._lives.values()), default=None)

    def _watch(self) -> None:
        while not self._ended.wait(LOOK_EVERY):
            for thread in threading.enumerate():
                if thread.name.startswith(self._prefix) and thread.native_id is not None:
                    self._look(thread.native_id)

    def _look(self, thread: int) -> None:
        now, waited = time.perf_counter(), time_in_queue(thread)
        if waited is None:
            return
        life = self._lives.setdefault(thread, _Life(now, waited, now, waited))
        life.last_seen, life.last_waited = now, waited


def time_in_queue(thread: int) -> float | None:
    """Time that a thread of this process was ready to run but had no core, s; None if the system does not tell."""
    try:
        return int(Path(f"/proc/self/task/{thread}/schedstat").read_text(encoding="ascii").split()[1]) * 1e-9
    except (OSError, ValueError, IndexError):
        return None
