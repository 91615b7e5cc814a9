"""Which texts in Python may run, and where each runs: in this process, or in one of its own where it can do no harm."""

import atexit
import ctypes
import gc
import os
import socket
import struct
import subprocess
import threading
from collections.abc import Generator
from contextlib import suppress
from typing import Any

import numpy as np

from flexlab.compiled import PLAIN_PYTHON
from flexlab.errors import FlexlabError, ScenarioError
from flexlab.files import short_hash
from flexlab.own.execution import ANSWERED, FAILED, Channel, RunningLaw, RunningPath, address_of
from flexlab.own.link import address_in
from flexlab.own.process import PROBE, OwnProcess
from flexlab.own.reading import TextProblem, is_foreign
from flexlab.physics.law_input import LAW_INPUT

ANSWER_LIMIT, LATE_LIMIT = 0.05, 0.03
"""Time until a law's answer is late, s: fifty control periods of 1 ms. Uninterrupted work after that until it is given up, s."""
POSES_LIMIT = 1.0
"""Time until a path's poses are late, s: a fifth of a millisecond for each."""
LateFunction = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
"""C function of a message's address; it returns `ANSWERED` if the answer may still come."""
TURN = b"\0"
"""The byte that a caller takes from a pipe before asking a law, and puts back afterwards."""


class LawApart(OwnProcess):
    """A control law in a process of its own, which kernels ask through a socket without holding Python's global lock."""

    sort, limit, patience, longest = "law", LATE_LIMIT, 2.0, 10.0
    running, kept = 3, 16
    """Running: the text in use, one that was refused, and the next one."""
    late = f"act did not answer within {1e3 * ANSWER_LIMIT:g} ms."

    def __init__(self, source: str, file: str):
        """Start the process; `ensure` waits until it is ready."""
        super().__init__(source, file)
        self._turn = os.pipe()
        """A pipe with one byte; the caller that has taken the byte may ask."""
        os.write(self._turn[1], TURN)
        for end in self._turn:
            self._open.callback(os.close, end)
        self._is_interrupted, self._earlier = False, ""
        outcomes = self._when_late()
        next(outcomes)
        self._late_function = LateFunction(outcomes.send)
        self.channel = Channel(0, address_of(self._late_function), self._calls.fileno(), *self._turn)

    def _start_again(self) -> None:
        turn = os.read(self._turn[0], 1)
        self._earlier = self._problem
        try:
            super()._start_again()
        finally:
            os.write(self._turn[1], turn)

    def _start(self) -> None:
        super()._start()
        self._calls.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 0, int(1e6 * ANSWER_LIMIT)))

    @property
    def problem(self) -> str:
        """The last problem, as a sentence; empty if there was none. Raises the KeyboardInterrupt that ended a call, once."""
        if self._is_interrupted:
            self._is_interrupted = False
            raise KeyboardInterrupt
        return super().problem

    @property
    def cause(self) -> str:
        """As `problem`; that of the process before while the new one, which a study may have started, has answered nothing."""
        return self.problem or ("" if self.has_answered else self._earlier)

    def _when_late(self) -> Generator[int, int]:
        """Tell the kernel, each time it asks, whether to go on waiting for an answer.

        Ctrl-C ends the kernel's read, and Python raises it where Python code goes on. In a generator that is within the `try`; in
        a function it would be before it.
        """
        outcome = FAILED
        while True:
            try:
                yield outcome
                outcome = ANSWERED if self._wait() else FAILED
            except KeyboardInterrupt:
                # The caller is machine code, which would drop it: the run ends, and `problem` raises it.
                self._is_interrupted, outcome = True, FAILED
            except Exception as error:
                self._problem, outcome = f"{self._name}: {type(error).__name__}: {error}.", FAILED


class PathApart(OwnProcess):
    """A path in a process of its own."""

    sort, limit, patience, longest = "path", POSES_LIMIT, POSES_LIMIT, 15.0
    late = f"position took longer than {POSES_LIMIT:g} s for its poses."

    def poses(self, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
        """Length and poses of the path, as `RunningPath.poses` returns them."""
        self.ensure()
        with self._lock:
            sizes = np.array([len(options), len(shares)], np.int64)
            try:
                self._calls.sendall(sizes.tobytes() + np.concatenate([options, shares]).tobytes())
                answer = np.frombuffer(self._received(8 * (1 + 3 * len(shares))), float)
            except OSError:
                self._give_up(self._how_it_ended())
                raise TextProblem(self._problem) from None
            if not np.isfinite(answer).all():
                self._listen(PROBE)
                problem, self._problem = self._problem, ""
                raise TextProblem(problem or f"{self._name}: it answered with something other than poses.")
        return float(answer[0]), answer[1:].reshape(-1, 3).copy()

    def _received(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            if not self._wait():
                raise TextProblem(self._problem)
            data += self._calls.recv(size - len(data))
        return data


_KINDS = {"law": (RunningLaw, LawApart), "path": (RunningPath, PathApart)}
"""What runs a text in this process, and in one of its own."""
known: dict[tuple[str, str, int], Any] = {}
"""What runs the texts, by "law" or "path", the text's digest and the thread it is for, or 0; the one used last stands last."""
_thread = threading.local()
_lock = threading.RLock()
_allowed: dict[str, str] = {}
_apart = False


def run_apart(apart: bool = True, output: int = subprocess.DEVNULL) -> None:
    """Run texts in Python in processes of their own from now on, as a lab does, or in this one.

    output: file descriptor to which the next processes print. Without compiled code all texts run in this process.
    """
    global _apart
    apart = apart and not PLAIN_PYTHON
    OwnProcess.output = output
    if _apart is not apart:
        close_all()
        _apart = apart


def run_alone() -> None:
    """Give this thread's laws objects or processes of their own: one that fails would end the runs of other threads."""
    _thread.number = threading.get_ident()


def close_ended() -> None:
    """End the processes of the laws of threads that have ended."""
    with _lock:
        there = {0, *(thread.ident for thread in threading.enumerate())}
        for key in [key for key in known if key[2] not in there]:
            ended = known.pop(key)
            if isinstance(ended, OwnProcess):
                ended.dispose()


def _key(sort: str, source: str) -> tuple[str, str, int]:
    """The key in `known` of what runs a text in this thread. All threads share paths, and programs, which may serve one only."""
    is_shared = sort != "law" or bool(address_in(source))
    return sort, short_hash(source), 0 if is_shared else getattr(_thread, "number", 0)


def host(sort: str, source: str) -> Any:
    """What runs an allowed text, a "law" or a "path". Raises `TextProblem` or `ScenarioError` if it cannot be run."""
    key, file = _key(sort, source), file_of(source)
    if not hasattr(os, "fork"):
        raise TextProblem(f"{file}: own laws and paths run on Linux and macOS only: on Windows, start flexlab in WSL.")
    with _lock:
        found = known.pop(key, None)
        if found is None:
            apart = _apart or (is_foreign(file) and not PLAIN_PYTHON)
            found = _KINDS[sort][apart](source, file)
        known[key] = found
        _retire(sort, file, key[2])
    return found


def _retire(sort: str, file: str, thread: int) -> None:
    """End the processes of a file's older texts; the engine may use the newest ones until a change reaches it."""
    apart = [(key, one) for key, one in reversed(known.items()) if isinstance(one, OwnProcess)]
    of_file = [key for key, one in apart if (one.sort, one.file, key[2]) == (sort, file, thread)]
    for number, key in enumerate(of_file):
        if number >= known[key].kept:
            known.pop(key).dispose()
        elif number >= known[key].running:
            known[key].close()


def stop_loading(file: str = "", source: str = "") -> None:
    """End processes that still load, so that nobody waits for them; given a `file`, those of its texts other than `source`."""
    for (_, text, _), one in list(known.items()):
        if not isinstance(one, OwnProcess) or one.is_loaded:
            continue
        if not file:
            one.close()
        elif one.file == file and text != short_hash(source):
            one.close("it was saved anew while it was loading.")


def close_all() -> None:
    """End all processes of laws and paths."""
    with _lock:
        for one in known.values():
            if isinstance(one, OwnProcess):
                one.close()
        known.clear()


@atexit.register
def _leave_nothing_open() -> None:
    """End all processes, and close their sockets, which Python would report under -W error."""
    if known:
        close_all()
        gc.collect()  # A law is part of a circle. A kernel that still runs keeps its law, and so its sockets.


def allow(source: str, file: str) -> None:
    """Let a text run; sentences name `file` as its place."""
    _allowed[short_hash(source)] = file


def allowed() -> dict[str, str]:
    """Digest → file of each text that may run, for another process (`allow_digests`)."""
    return dict(_allowed)


def allow_digests(files: dict[str, str]) -> None:
    """Allow what another process of the same person allows."""
    _allowed.update(files)


def file_of(source: str) -> str:
    """The file of a text that may run; empty for any other."""
    return _allowed.get(short_hash(source), "")


def is_allowed(source: str) -> bool:
    """Whether a text may run here."""
    return short_hash(source) in _allowed


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
        found = host("law", source)
        found.ensure()
    except (TextProblem, FlexlabError) as error:
        with _lock:
            known.pop(_key("law", source), None)
        raise ScenarioError([("controller.source", f"The control law {kind} cannot be used: {error}")]) from None
    return found


def make_ready(gains: Any) -> None:
    """Make the law that a record of gains reaches ready for a run; if that fails, its `problem` says why."""
    for one in list(known.values()):
        if isinstance(one, (RunningLaw, LawApart)):
            if (one.channel.answer, one.channel.calls) == (int(gains.answer), int(gains.calls)):
                with suppress(TextProblem):
                    one.ensure()


def known_law(source: str) -> RunningLaw | LawApart | None:
    """What runs a law; None if nothing does yet."""
    return known.get(_key("law", source))


def ask_plainly(gains: Any, now: Any) -> int:
    """Make one call of a law and return its outcome, where kernels are not compiled (`compiled.PLAIN_PYTHON`)."""
    laws = [one for one in list(known.values()) if isinstance(one, RunningLaw)]
    asked = next(law for law in laws if law.channel.answer == int(gains.answer))
    return asked.ask(gains, np.frombuffer(now.tobytes(), LAW_INPUT)[0])
