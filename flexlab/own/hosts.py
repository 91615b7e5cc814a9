"""Which texts in Python may run in this process, and where each runs: here, or in a process of its own that can do no harm."""

import subprocess
import threading
from typing import Any, Generic, TypeVar

import numpy as np

from flexlab.compiled import PLAIN_PYTHON
from flexlab.errors import FlexlabError, ScenarioError
from flexlab.own.apart import LawApart, PathApart
from flexlab.own.elsewhere import address_in, is_foreign
from flexlab.own.execution import (
    AnswerFunction,
    Channel,
    RunningLaw,
    RunningPath,
    TextProblem,
    address_of,
    message_at,
    now_at,
)
from flexlab.own.process import OwnProcess
from flexlab.own.reading import digest


class LawHere:
    """A law that runs here, as a person's own code does in their own shell."""

    def __init__(self, source: str, file: str):
        """Raises `TextProblem` or `ScenarioError` for a text that cannot be run."""
        self._law = RunningLaw(source, file)
        self._lock = threading.Lock()
        self._function = AnswerFunction(self._answer)
        self.channel = Channel(address_of(self._function), 0, -1, -1, -1)
        self.problem = ""
        """What went wrong last, as a sentence; empty: nothing."""

    def ensure(self) -> None:
        """Be ready for a run; what went wrong before is forgotten."""
        self.problem = ""

    @property
    def is_ready(self) -> bool:
        """Whether a call is answered at once."""
        return True

    def close(self) -> None:
        """Nothing to close."""

    def ask(self, message: np.ndarray, now: np.ndarray) -> None:
        """One call."""
        with self._lock:  # Runs of several threads share the object.
            text = self._law.answer(message, now)
        if text:
            self.problem = text

    def _answer(self, message: int, now: int) -> None:
        self.ask(message_at(message), now_at(now))


class PathHere:
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


Host = TypeVar("Host", LawHere | LawApart, PathHere | PathApart)


class Hosts(Generic[Host]):
    """Where the texts of one sort run: by digest, the one that was asked for last stands last."""

    def __init__(self, here: type[Host], apart: type[Host], running: int, kept: int):
        """Of one file's texts, newest first: the processes of `running` live, the sockets of `kept` stay open."""
        self._kinds, self._running, self._kept = {False: here, True: apart}, running, kept
        self.known: dict[str, Host] = {}
        self._lock = threading.Lock()

    def get(self, source: str) -> Host:
        """Raises `TextProblem` or `ScenarioError` for a text that cannot be run."""
        key = digest(source)
        with self._lock:
            host = self.known.pop(key, None)
            if host is None:
                apart = _apart or (is_foreign(_allowed[key]) and not PLAIN_PYTHON)
                host = self._kinds[apart](source, _allowed[key])
            self.known[key] = host
            self._retire(_allowed[key])
        return host

    def forget(self, source: str) -> None:
        """Make it anew when it is asked for again."""
        with self._lock:
            self.known.pop(digest(source), None)

    def stop_loading(self) -> None:
        """End the processes that are not ready yet, so that nobody waits for them."""
        for host in list(self.known.values()):
            if isinstance(host, OwnProcess):
                host.close_unless_loaded()

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            for host in self.known.values():
                host.close()
            self.known.clear()

    def _retire(self, file: str) -> None:
        """End the processes of a file's older texts: the engine may still use the last ones, until a change reaches it."""
        of_file = [
            key for key, host in self.known.items() if isinstance(host, OwnProcess) and _allowed.get(key) == file
        ]
        for number, key in enumerate(reversed(of_file)):
            host = self.known[key]
            assert isinstance(host, OwnProcess)
            if number >= self._kept:
                del self.known[key]
                host.dispose()
            elif number >= self._running:
                host.close()


TEXTS_RUNNING = 3
"""Of one law's file: the one in use, one that was refused, the next one."""
LAW_HOSTS: Hosts[Any] = Hosts(LawHere, LawApart, TEXTS_RUNNING, 16)
PATH_HOSTS: Hosts[Any] = Hosts(PathHere, PathApart, 1, 1)
_allowed: dict[str, str] = {}
_apart = False


def run_apart(apart: bool = True, output: int = subprocess.DEVNULL) -> None:
    """From now on texts in Python run in processes of their own, as they do in a lab, or here.

    output: the file to which those of the next processes write what their texts print. Without compiled code all run here.
    """
    global _apart
    apart = apart and not PLAIN_PYTHON
    OwnProcess.output = output
    if _apart is not apart:
        close_all()
        _apart = apart


def stop_loading() -> None:
    """End the processes that are not ready yet, so that nobody waits for them."""
    LAW_HOSTS.stop_loading()
    PATH_HOSTS.stop_loading()


def close_all() -> None:
    """End all processes of laws and paths."""
    LAW_HOSTS.close()
    PATH_HOSTS.close()


def allow(source: str, file: str) -> None:
    """Let a text run, which stands in `file` (its name is enough for sentences)."""
    _allowed[digest(source)] = file


def allowed() -> dict[str, str]:
    """What may run: file by digest of its text, to be handed to another process (`allow_digests`)."""
    return dict(_allowed)


def allow_digests(files: dict[str, str]) -> None:
    """Allow what another process of the same person allows."""
    _allowed.update(files)


def file_of(source: str) -> str:
    """The file in which a text stands; empty if none was given."""
    return _allowed.get(digest(source), "")


def is_allowed(source: str) -> bool:
    """Whether a text may run here."""
    return digest(source) in _allowed


def not_allowed(source: str, kind: str) -> str:
    """Why a law that came with a scenario does not run."""
    if address := address_in(source):
        return (
            f"The control law {kind} of this scenario is the program at {address}, to which flexlab does not connect by "
            f"itself. If it is yours, start it and give --law {address}, or answer yes where flexlab replay asks."
        )
    return (
        f"The control law {kind} came with this scenario as Python code, which does not run by itself. If you know who wrote "
        "it and have read it, allow it: give its file with --law, or answer yes where flexlab replay asks."
    )


def host_of(source: str, kind: str) -> LawHere | LawApart:
    """Where a law runs, ready. Raises `ScenarioError` if it may not, or cannot be run."""
    if not is_allowed(source):
        raise ScenarioError([("controller.source", not_allowed(source, kind))])
    try:
        host = LAW_HOSTS.get(source)
        host.ensure()
    except (TextProblem, FlexlabError) as error:
        LAW_HOSTS.forget(source)
        raise ScenarioError([("controller.source", f"The control law {kind} cannot be used: {error}")]) from None
    return host


def is_ready(source: str) -> bool:
    """Whether a law answers at once."""
    host = LAW_HOSTS.known.get(digest(source))
    return host is not None and host.is_ready


def problem(source: str) -> str:
    """What a law did wrong last, as a sentence; empty: nothing."""
    host = LAW_HOSTS.known.get(digest(source))
    return host.problem if host is not None else ""


def ask_plainly(channel: Any, message: np.ndarray, now: Any) -> None:
    """One call of a law without compiled code, for `compiled.PLAIN_PYTHON`."""
    host = next(host for host in LAW_HOSTS.known.values() if host.channel.answer == int(channel.answer))
    assert isinstance(host, LawHere), "laws in processes of their own need compiled kernels"
    host.ask(message, np.frombuffer(now.tobytes(), np.uint8))


def poses_of(source: str, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
    """As `RunningPath.poses`, of an allowed path. Raises `TextProblem` or `ScenarioError`."""
    return PATH_HOSTS.get(source).poses(options, shares)
