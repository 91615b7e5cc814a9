"""Where the text of a law in Python runs: in this process, or in one of its own that can do the lab no harm."""

import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from flexlab.control.own_law_channel import AnswerFunction, Channel, address_of, message_at, now_at
from flexlab.control.own_law_process import Apart
from flexlab.errors import FlexlabError, ScenarioError
from flexlab.own_laws.declaration import digest
from flexlab.own_laws.execution import RunningLaw
from flexlab.own_laws.running_text import TextProblem


class InProcess:
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


def ask_plainly(channel: Any, message: np.ndarray, now: Any) -> None:
    """One call without compiled code, for `compiled.PLAIN_PYTHON`."""
    host = next(host for host in _hosts.values() if host.channel.answer == int(channel.answer))
    assert isinstance(host, InProcess), "laws in processes of their own need compiled kernels"
    host.ask(message, np.frombuffer(now.tobytes(), np.uint8))


TEXTS_RUNNING = 3
"""Of one file, newest first, whose processes live: the one in use, one that was refused, the next one."""
TEXTS_KEPT = 16
"""Of one file, whose sockets are kept open."""
Host = InProcess | Apart
_allowed: dict[str, str] = {}
_hosts: dict[str, Host] = {}
_lock = threading.Lock()
_kind: Callable[[str, str], Host] = InProcess


def run_apart(apart: bool = True) -> None:
    """From now on laws in Python run in processes of their own, as they do in a lab, or here."""
    global _kind
    wanted = Apart if apart else InProcess
    if _kind is not wanted:
        close_all()
        _kind = wanted


def runs_apart() -> bool:
    """Whether texts in Python run in processes of their own."""
    return _kind is Apart


def allow(source: str, file: str) -> None:
    """Let a law's text run, which stands in `file` (its name is enough for sentences)."""
    _allowed[digest(source)] = file


def allowed() -> dict[str, str]:
    """What may run: file by digest of its text, to be handed to another process (`allow_digests`)."""
    return dict(_allowed)


def allow_digests(files: dict[str, str]) -> None:
    """Allow what another process of the same person allows."""
    _allowed.update(files)


def file_of(source: str) -> str:
    """The file in which a law's text stands; empty if none was given."""
    return _allowed.get(digest(source), "")


def is_allowed(source: str) -> bool:
    """Whether a law's text may run here."""
    return digest(source) in _allowed


def host_of(source: str, kind: str) -> Host:
    """Where a law runs, ready. Raises `ScenarioError` if it may not, or cannot be run."""
    key = digest(source)
    if key not in _allowed:
        raise ScenarioError([("controller.source", not_allowed(kind))])
    try:
        with _lock:
            host = _hosts.get(key)
            if host is None:
                host = _hosts[key] = _kind(source, _allowed[key])
            _hosts[key] = _hosts.pop(key)  # The one that was asked for last stands last.
            _retire(_allowed[key])
        host.ensure()
    except (TextProblem, FlexlabError) as error:
        with _lock:
            _hosts.pop(key, None)
        raise ScenarioError([("controller.source", f"The control law {kind} cannot be used: {error}")]) from None
    return host


def _retire(file: str) -> None:
    """End the processes of a file's older texts: the engine may still use the last ones, until a change reaches it."""
    apart = [(key, host) for key, host in _hosts.items() if isinstance(host, Apart) and _allowed.get(key) == file]
    for number, (key, host) in enumerate(reversed(apart)):
        if number >= TEXTS_KEPT:
            _hosts.pop(key)
            host.dispose()
        elif number >= TEXTS_RUNNING:
            host.close()


def stop_loading() -> None:
    """End the processes that are not ready yet, so that nobody waits for them."""
    for host in list(_hosts.values()):
        if isinstance(host, Apart):
            host.close_unless_loaded()


def not_allowed(kind: str) -> str:
    """Why a law that came with a scenario does not run."""
    return (
        f"The control law {kind} came with this scenario as Python code, which does not run by itself. If you know who wrote "
        "it and have read it, allow it: give its file with --law, or answer yes where flexlab replay asks."
    )


def is_ready(source: str) -> bool:
    """Whether a law answers at once."""
    host = _hosts.get(digest(source))
    return host is not None and host.is_ready


def problem(source: str) -> str:
    """What a law did wrong last, as a sentence; empty: nothing."""
    host = _hosts.get(digest(source))
    return host.problem if host is not None else ""


def close_all() -> None:
    """End all processes of laws."""
    with _lock:
        for host in _hosts.values():
            host.close()
        _hosts.clear()
