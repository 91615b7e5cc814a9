"""The process in which a person's text runs: it reads calls from a socket, answers them, and reports what goes wrong.

Its arguments: CALLS REPORTS LIFELINE FILE SORT  (file descriptors of two sockets and a pipe; SORT: law or path)

A supervisor process ends everything that the text started, once the text has ended or the lab is gone.

A law's call is a message and a `LAW_INPUT` record; its answer is the first ANSWER_BYTES of the message. A path's call is
two int64, the numbers of options and of shares, then options and shares as float64; its answer is (1 + 3 shares) float64: the
path's length, then a pose for each share. An error is sent as a report; a path then answers NaN as well.
"""

import codecs
import contextlib
import ctypes
import faulthandler
import os
import select
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np

from flexlab.errors import FlexlabError
from flexlab.own.execution import ANSWER_BYTES, ANSWERED, FAILED, MESSAGE, RunningLaw, RunningPath
from flexlab.own.reading import TextProblem
from flexlab.physics.law_input import LAW_INPUT
from flexlab.text import visible

T = TypeVar("T")
PERIOD = 0.25
"""Time between two checks of a text's processes, s."""
MOST_PROCESSES = 32
"""The most processes that a text may have at once."""
MOST_MEMORY = 2_000_000_000
"""Limit, in bytes, on the address space of each process of a text and on the memory that they use together."""
MOST_PRINTED = 1_000_000
"""Bytes that a text may print. The rest is dropped: an endless loop that prints would fill a log or a disk."""
SET_PARENT_DEATH_SIGNAL, SET_CHILD_SUBREAPER = 1, 36
"""Options of Linux's prctl."""
ROUNDS = 50
"""The most rounds of stopping a text's processes before all are killed."""


def receive(calls: socket.socket, size: int) -> bytearray | None:
    """Read exactly `size` bytes; None once the other end is closed."""
    data = bytearray()
    while len(data) < size and (part := calls.recv(size - len(data))):
        data += part
    return data if len(data) == size else None


class Report(msgspec.Struct, omit_defaults=True):
    """A message from the process to the lab, one line of JSON."""

    pid: int = 0
    """Number of the process in which the text runs."""
    ready: bool = False
    problem: str = ""
    warning: str = ""
    answered: bool = False
    """Whether the text has answered its first call."""


Say = Callable[..., None]
"""Sends a `Report` with these fields to the lab."""


def _watch_exits(say: Say, file: str) -> None:
    """Make os._exit and os.abort report the line that called them."""
    own = os.getpid()

    def telling(name: str, function: Any) -> Any:
        def end(*words: Any) -> None:
            if os.getpid() != own:  # Processes that the text started may end.
                function(*words)
            lines = [frame.lineno for frame in traceback.extract_stack() if frame.filename == file]
            line = f", line {lines[-1]}" if lines else ""
            say(problem=f"{os.path.basename(file)}{line}: it ended its own process with os.{name}.")
            function(*words)

        return end

    os._exit, os.abort = telling("_exit", os._exit), telling("abort", os.abort)


def _serve(load: Callable[[str, str], T], answer: Callable[[T, socket.socket, Say], None]) -> None:
    """Run one text: `load` it (text, file), then `answer` calls until the lab closes the socket.

    The text arrives through the socket for calls, after its length. When the lab closes the lifeline, this process ends, and so
    does everything that the text started.
    """
    calls, reported = socket.socket(fileno=int(sys.argv[1])), socket.socket(fileno=int(sys.argv[2]))
    file = sys.argv[4]

    def say(pid: int = 0, ready: bool = False, problem: str = "", warning: str = "", answered: bool = False) -> None:
        # Lone surrogates, which UTF-8 cannot encode, are made visible.
        reported.sendall(msgspec.json.encode(Report(pid, ready, visible(problem), visible(warning), answered)) + b"\n")

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the lab, which then closes the lifeline.
    name = os.path.basename(file)
    _supervised([calls.fileno()], int(sys.argv[3]), lambda text: say(problem=f"{name}: {text}."))
    for ours in (calls, reported):  # Otherwise a process that the text forks would answer the calls again.
        os.register_at_fork(after_in_child=ours.close)
    say(pid=os.getpid())
    # The lab asks for a traceback when an answer is late: this handler works even while Python is busy.
    faulthandler.register(signal.SIGUSR1, file=reported.fileno(), all_threads=False, chain=False)
    faulthandler.enable(file=reported.fileno(), all_threads=False)
    length = receive(calls, 8)
    text = length and receive(calls, int.from_bytes(length, "little"))
    if text is None:
        return
    _watch_exits(say, file)
    # A text may import what is in the working folder, last of all; and programs that it starts, what is beside them.
    sys.path.append("")
    os.environ.pop("PYTHONSAFEPATH", None)
    try:
        loaded = load(text.decode(), file)
    except (TextProblem, FlexlabError) as error:
        say(problem=str(error))
        return
    say(ready=True)
    answer(loaded, calls, say)
    _send(os.getppid(), signal.SIGCONT)  # The text may have stopped its supervisor, which has to end too.


def _answer_law(law: RunningLaw, calls: socket.socket, say: Say) -> None:
    warned = answered = False
    while (data := receive(calls, MESSAGE.itemsize + LAW_INPUT.itemsize)) is not None:
        message = np.frombuffer(data, MESSAGE, 1)[0]
        text = law.answer(message, np.frombuffer(data, LAW_INPUT, 1, MESSAGE.itemsize)[0])
        if text:
            say(problem=text)
        elif not answered:
            say(answered=True)
            answered = True
        if law.warning and not warned:
            say(warning=law.warning)
            warned = True
        message["outcome"] = FAILED if text else ANSWERED
        calls.sendall(memoryview(data)[:ANSWER_BYTES])


def _answer_path(path: RunningPath, calls: socket.socket, say: Say) -> None:
    while (head := receive(calls, 16)) is not None:
        options, shares = np.frombuffer(head, np.int64).tolist()
        data = receive(calls, 8 * (options + shares))
        if data is None:
            return
        numbers, answer = np.frombuffer(data, float), np.full(1 + 3 * shares, np.nan)
        try:
            span, poses = path.poses(numbers[:options], numbers[options:])
            answer[0], answer[1:] = span, poses.ravel()
        except TextProblem as problem:
            say(problem=str(problem))
        calls.sendall(answer.tobytes())


def _supervised(calls: list[int], lifeline: int, say: Callable[[str], None]) -> None:
    """Fork and return in the new process, where the text may run; this one supervises it and ends with the same status.

    calls: file descriptors that only the text's process uses. lifeline: the reading end of a pipe; everything ends when its
    other end is closed. `say` reports a problem.
    """
    _control(SET_CHILD_SUBREAPER, 1)  # Orphaned processes become children of this one, which finds them.
    above, here = os.getppid(), os.getpid()
    printed, printing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(lifeline)
        os.close(printed)
        os.dup2(printing, sys.stdout.fileno())
        os.close(printing)
        _control(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != here:
            os._exit(0)
        _limit_memory()
        return
    for number in (*calls, printing):
        os.close(number)
    passing_on = threading.Thread(target=_pass_on, args=(printed,), daemon=True)
    passing_on.start()
    signal.signal(signal.SIGUSR1, lambda *_: _send(pid, signal.SIGUSR1))
    ended = _watch(pid, above, lifeline, say)
    _end(pid)
    passing_on.join(PERIOD)
    if ended is not None and os.WIFSIGNALED(ended):
        number = os.WTERMSIG(ended)
        if number != signal.SIGKILL:
            signal.signal(number, signal.SIG_DFL)
        os.kill(here, number)
    os._exit(1 if ended is None else os.waitstatus_to_exitcode(ended))


def _pass_on(printed: int) -> None:
    """Print what arrives through a pipe, made `visible`, up to `MOST_PRINTED` bytes."""
    decoded, left = codecs.getincrementaldecoder("utf-8")("replace"), MOST_PRINTED
    while data := os.read(printed, 65536):
        if left >= 0:
            more = f"\nWhat is printed beyond {MOST_PRINTED / 1e6:g} MB is left out.\n" if len(data) > left else ""
            with contextlib.suppress(OSError):  # Nobody reads it any more.
                os.write(sys.stdout.fileno(), (visible(decoded.decode(data[:left])) + more).encode())
            left -= len(data)


def _watch(pid: int, above: int, lifeline: int, say: Callable[[str], None]) -> int | None:
    """Wait for the text's process: return its status once it has ended, None if it has to be ended."""
    while True:
        found, status = os.waitpid(pid, os.WNOHANG)
        if found == pid:
            return status
        if select.select([lifeline], [], [], PERIOD)[0] or os.getppid() != above:
            return None
        others = _descendants() - {pid}
        for other in others:
            with contextlib.suppress(ChildProcessError):  # Leave no zombies.
                os.waitpid(other, os.WNOHANG)
        if len(others) >= MOST_PROCESSES:
            say(f"it started more than {MOST_PROCESSES} processes, the most that a file may have")
            return None
        if others and sum(map(_memory, others | {pid})) > MOST_MEMORY:
            say(f"it and the processes that it started use more than {MOST_MEMORY / 1e9:g} GB of memory")
            return None


def _end(pid: int) -> None:
    """Stop the text's process and its descendants, so that none starts another, and kill them."""
    stopped: set[int] = set()
    for _ in range(ROUNDS):
        new = (_descendants() | {pid}) - stopped
        if not new:
            break
        for each in new:
            _send(each, signal.SIGSTOP)
        stopped |= new
    for each in stopped:
        _send(each, signal.SIGKILL)
    with contextlib.suppress(ChildProcessError):
        while True:
            os.waitpid(-1, 0)


def _descendants() -> set[int]:
    """All descendants of this process; empty where the system does not list them."""
    found: set[int] = set()
    above = [os.getpid()]
    while above:
        for task in Path(f"/proc/{above.pop()}/task").glob("*/children"):
            with contextlib.suppress(OSError):
                new = set(map(int, task.read_text().split())) - found
                found |= new
                above += new
    return found


def _memory(pid: int) -> int:
    """Bytes that a process uses and shares with no other."""
    try:
        _, resident, shared = map(int, Path(f"/proc/{pid}/statm").read_text().split()[:3])
    except (OSError, ValueError):
        return 0
    return (resident - shared) * os.sysconf("SC_PAGE_SIZE")


def _send(pid: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def _control(option: int, value: int) -> None:
    """Call prctl on Linux; do nothing elsewhere."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def _limit_memory() -> None:
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    except (ImportError, ValueError, OSError):
        pass  # This system has no such limit.


def main() -> None:
    """Serve the text whose description the arguments give until its lab is gone."""
    # `from flexlab import *` would load libraries that need more than MOST_MEMORY.
    interface: Any = sys.modules["flexlab"]
    interface.__all__ = [name for name, module in interface._HOMES.items() if module.startswith("flexlab.own.")]
    if sys.argv[5] == "law":
        _serve(RunningLaw, _answer_law)
    else:
        _serve(RunningPath, _answer_path)
