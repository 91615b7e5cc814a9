"""Ends all that a person's own text started: processes of processes too, with the text, and when the lab is gone."""

import contextlib
import ctypes
import os
import select
import signal
import sys
from collections.abc import Callable
from pathlib import Path

PERIOD = 0.25
"""s between two looks at what a text has started."""
MOST_PROCESSES = 32
"""That a text may have at once."""
MOST_MEMORY = 2_000_000_000
"""Bytes: of address space for each process of a text, of memory in use for all together."""
SET_PARENT_DEATH_SIGNAL, SET_CHILD_SUBREAPER = 1, 36
"""Of Linux's prctl."""
ROUNDS = 50
"""In which all that is found is stopped until nothing new is, before it is killed."""


def supervised(calls: list[int], lifeline: int, say: Callable[[str], None]) -> None:
    """Returns in a new process, in which the text may run; this one stays behind, looks after it and ends as it does.

    calls: numbers of files that only the text's process uses. lifeline: the reading end of a pipe; when its other end is
    closed, everything ends. `say` tells the lab what was wrong.
    """
    _control(SET_CHILD_SUBREAPER, 1)  # What outlives its own parent becomes this one's child, and is found.
    above, here = os.getppid(), os.getpid()
    pid = os.fork()
    if pid == 0:
        os.close(lifeline)
        _control(SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != here:
            os._exit(0)
        _limit_memory()
        return
    for number in calls:
        os.close(number)
    signal.signal(signal.SIGUSR1, lambda *_: _send(pid, signal.SIGUSR1))
    ended = _watch(pid, above, lifeline, say)
    _end(pid)
    if ended is not None and os.WIFSIGNALED(ended):
        number = os.WTERMSIG(ended)
        if number != signal.SIGKILL:
            signal.signal(number, signal.SIG_DFL)
        os.kill(here, number)
    os._exit(1 if ended is None else os.waitstatus_to_exitcode(ended))


def _watch(pid: int, above: int, lifeline: int, say: Callable[[str], None]) -> int | None:
    """Wait until the text's process has ended (its status), or has to (None)."""
    while True:
        found, status = os.waitpid(pid, os.WNOHANG)
        if found == pid:
            return status
        if select.select([lifeline], [], [], PERIOD)[0] or os.getppid() != above:
            return None
        others = _descendants() - {pid}
        for other in others:
            with contextlib.suppress(ChildProcessError):  # Of those that became this one's, none is left as a zombie.
                os.waitpid(other, os.WNOHANG)
        if len(others) >= MOST_PROCESSES:
            say(f"it started more than {MOST_PROCESSES} processes, which is more than a file may")
            return None
        if others and sum(map(_memory, others | {pid})) > MOST_MEMORY:
            say(f"it and the processes that it started use more than {MOST_MEMORY / 1e9:g} GB of memory")
            return None


def _end(pid: int) -> None:
    """Kill the text's process and all that came of it; first all are stopped, so that none starts another meanwhile."""
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
    """All processes below this one; none where the system does not tell."""
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
    """Bytes in use that a process shares with no other."""
    try:
        _, resident, shared = map(int, Path(f"/proc/{pid}/statm").read_text().split()[:3])
    except (OSError, ValueError):
        return 0
    return (resident - shared) * os.sysconf("SC_PAGE_SIZE")


def _send(pid: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def _control(option: int, value: int) -> None:
    """Linux's prctl; nothing elsewhere."""
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(option, value, 0, 0, 0)


def _limit_memory() -> None:
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))
    except (ImportError, ValueError, OSError):
        pass  # Where the system has no such limit, its own must do.
