"""Which texts in Python may run, and where each runs: in this process, or in one of its own where it can do no harm."""

import subprocess
import threading
from typing import Any, Generic, TypeVar

import numpy as np

from flexlab.compiled import PLAIN_PYTHON
from flexlab.errors import FlexlabError, ScenarioError
from flexlab.own.apart import LawApart, PathApart
from flexlab.own.execution import RunningLaw, RunningPath
from flexlab.own.link import address_in
from flexlab.own.process import OwnProcess
from flexlab.own.reading import TextProblem, digest, is_foreign

Host = TypeVar("Host", RunningLaw | LawApart, RunningPath | PathApart)


class Hosts(Generic[Host]):
    """What runs the laws, or the paths, by digest of their texts; the one used last stands last."""

    def __init__(self, here: type[Host], apart: type[Host], running: int, kept: int):
        """Of one file's texts, the newest `running` keep their processes and the newest `kept` their sockets."""
        self._kinds, self._running, self._kept = {False: here, True: apart}, running, kept
        self.known: dict[str, Host] = {}
        self._lock = threading.Lock()

    def get(self, source: str) -> Host:
        """What runs an allowed text. Raises `TextProblem` or `ScenarioError` if it cannot be run."""
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
        for process in self._processes():
            if not process.is_loaded:
                process.close()

    def close(self) -> None:
        """End all processes."""
        with self._lock:
            for process in self._processes():
                process.close()
            self.known.clear()

    def _processes(self) -> list[OwnProcess]:
        return [host for host in list(self.known.values()) if isinstance(host, OwnProcess)]

    def _retire(self, file: str) -> None:
        """End the processes of a file's older texts; the engine may use the newest ones until a change reaches it."""
        hosts = reversed(self.known.items())
        of_file = [(key, host) for key, host in hosts if isinstance(host, OwnProcess) and _allowed.get(key) == file]
        for key, host in of_file[self._kept :]:
            del self.known[key]
            host.dispose()
        for _, host in of_file[self._running : self._kept]:
            host.close()


TEXTS_RUNNING = 3
"""Of one law's file: the text in use, one that was refused, and the next one."""
LAW_HOSTS: Hosts[Any] = Hosts(RunningLaw, LawApart, TEXTS_RUNNING, 16)
PATH_HOSTS: Hosts[Any] = Hosts(RunningPath, PathApart, 1, 1)
_allowed: dict[str, str] = {}
_apart = False


def run_apart(apart: bool = True, output: int = subprocess.DEVNULL) -> None:
    """Run texts in Python in processes of their own from now on, as a lab does, or in this one.

    output: the file to which the next processes print. Without compiled code all texts run in this process.
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
    """Let a text run that stands in `file`; sentences name that file."""
    _allowed[digest(source)] = file


def allowed() -> dict[str, str]:
    """File by digest of each text that may run, for another process (`allow_digests`)."""
    return dict(_allowed)


def allow_digests(files: dict[str, str]) -> None:
    """Allow what another process of the same person allows."""
    _allowed.update(files)


def file_of(source: str) -> str:
    """The file of a text that may run; empty for any other."""
    return _allowed.get(digest(source), "")


def is_allowed(source: str) -> bool:
    """Whether a text may run here."""
    return digest(source) in _allowed


def not_allowed(source: str, kind: str) -> str:
    """Why a law that came with a scenario does not run, and how to let it."""
    if address := address_in(source):
        return (
            f"The control law {kind} of this scenario is the program at {address}, to which flexlab does not connect by "
            f"itself. If it is yours, start it and give --law {address}, or answer yes where flexlab replay asks."
        )
    return (
        f"The control law {kind} came with this scenario as Python code, which does not run by itself. If you know who wrote "
        "it and have read it, allow it: give its file with --law, or answer yes where flexlab replay asks."
    )


def host_of(source: str, kind: str) -> RunningLaw | LawApart:
    """What runs a law, ready to be asked. Raises `ScenarioError` if it may not or cannot run."""
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
    """What went wrong with a law last, as a sentence; empty if nothing did."""
    host = LAW_HOSTS.known.get(digest(source))
    return host.problem if host is not None else ""


def ask_plainly(channel: Any, message: np.ndarray, now: Any) -> None:
    """One call of a law where kernels are not compiled (`compiled.PLAIN_PYTHON`)."""
    host = next(host for host in LAW_HOSTS.known.values() if host.channel.answer == int(channel.answer))
    assert isinstance(host, RunningLaw), "laws in processes of their own need compiled kernels"
    host.ask(message, np.frombuffer(now.tobytes(), np.uint8))
