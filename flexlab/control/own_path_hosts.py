"""Where the text of a path in Python runs: in this process, or in one of its own that can do the lab no harm."""

import select
import threading
import time
from typing import Any

import numpy as np

from flexlab.control import own_law_hosts as permission
from flexlab.control.own_process import PROBE, OwnProcess
from flexlab.own_laws.declaration import digest
from flexlab.own_laws.running_text import TextProblem
from flexlab.own_paths.child import FAILED
from flexlab.own_paths.execution import RunningPath

ANSWER_LIMIT = 1.0
"""s, without those for which the machine was busy elsewhere, until poses count as late: a fifth of a millisecond for each."""
PATIENCE = 15.0
"""s after which late poses are given up however busy the machine is."""


class InProcess:
    """A path that runs here, as a person's own code does in their own shell."""

    def __init__(self, source: str, file: str):
        """Raises `TextProblem` or `ScenarioError` for a text that cannot be run."""
        self._path, self._lock = RunningPath(source, file), threading.Lock()

    def poses(self, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
        """As `RunningPath.poses`."""
        with self._lock:  # Runs of several threads share the object.
            return self._path.poses(options, shares)

    def close(self) -> None:
        """Nothing to close."""


class Apart(OwnProcess):
    """A path in a process of its own: what it does wrong is a sentence, and nothing else."""

    module = "flexlab.own_paths.child"

    def poses(self, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
        """As `RunningPath.poses`, within `ANSWER_LIMIT`."""
        self.ensure()
        with self._lock:
            sizes = np.array([len(options), len(shares)], np.int64)
            try:
                self._calls.sendall(sizes.tobytes() + np.concatenate([options, shares]).tobytes())
                count = int(np.frombuffer(self._received(8), np.int64)[0])
                if count not in (FAILED, len(shares)):
                    raise self._over(f"{self._name}: it answered with {count} poses where {len(shares)} are due.")
                if count == FAILED:
                    self._listen(PROBE)
                    problem, self._problem = self._problem, ""
                    raise TextProblem(problem)
                answer = np.frombuffer(self._received(8 * (1 + 3 * count)), float)
            except OSError:
                raise self._over(self._how_it_ended()) from None
        return float(answer[0]), answer[1:].reshape(count, 3).copy()

    def _received(self, size: int) -> bytes:
        data, worked, end = b"", 0.0, time.monotonic() + PATIENCE
        while len(data) < size:
            before, waited = time.monotonic(), self._waited()
            if select.select([self._calls], [], [], PROBE)[0]:
                part = self._calls.recv(size - len(data))
                if not part:
                    raise self._over(self._how_it_ended())
                data += part
                continue
            worked += max(0.0, time.monotonic() - before - (self._waited() - waited))
            if worked > ANSWER_LIMIT or time.monotonic() > end:
                problem = f"{self._name}{self._line()}: position took longer than {ANSWER_LIMIT:g} s for its poses."
                raise self._over(problem)
        return data

    def _over(self, problem: str) -> TextProblem:
        self._gave_up(problem)
        return TextProblem(self._problem)


_hosts: dict[str, tuple[str, Any]] = {}
"""File → digest of the text that runs, and where it does."""
_lock = threading.Lock()


def poses_of(source: str, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
    """As `RunningPath.poses`, of an allowed text. Raises `TextProblem` or `ScenarioError`."""
    file, key = permission.file_of(source), digest(source)
    kind = Apart if permission.runs_apart() else InProcess
    with _lock:
        present, host = _hosts.get(file, ("", None))
        if present != key or type(host) is not kind:
            if host is not None:
                host.close()
            host = kind(source, file)
            _hosts[file] = key, host
    return host.poses(options, shares)


def stop_loading() -> None:
    """End the processes that are not ready yet."""
    for _, host in list(_hosts.values()):
        if isinstance(host, Apart):
            host.close_unless_loaded()


def close_all() -> None:
    """End all processes of paths."""
    with _lock:
        for _, host in _hosts.values():
            host.close()
        _hosts.clear()
