"""Long work on runs (comparing, replaying, exporting) in separate processes, so that labs and pages never wait for it.

The first functions here also start the processes of labs.
"""

import asyncio
import contextlib
import inspect
import logging
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import AsyncGenerator, Callable, Generator
from dataclasses import dataclass
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flexlab.errors import FlexlabError, LabError
from flexlab.machine import give_way, limit_memory
from flexlab.own.files import know_own_files
from flexlab.own.hosts import allowed
from flexlab.recording.store.run_files import vanished
from flexlab.server.limits import Limit, Visitor
from flexlab.text import tell_failures_plainly

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, SpawnContext

LAB_PROGRAM = "flexlab.server.labs.preloaded"
"""The module imported by the process from which labs and jobs are forked."""
LONGEST_SOCKET = 107
"""Most bytes of a socket's path on Linux."""
SOCKET_NAME = 40
"""Bytes that Python's fork server adds to the path of the temporary folder: a folder of its own and the socket's name."""
AT_ONCE = 4
"""Most tasks that run at once: one only for the teacher, and one only for what a visitor's browser waits for. They have low
priority, so more would only be slower."""
MOST_OF_ONE, MOST_OF_ADDRESS, MOST = 4, 30, 40
"""Most running and waiting tasks: of one visitor, of one address, and of all visitors."""
MOST_OF_TEACHER = 10
"""Most running and waiting tasks of the teacher, in addition."""
LOW_PRIORITY, LOWEST_PRIORITY = 10, 19
"""Unix niceness of tasks, below the labs, and of work for which nobody waits."""
MOST_MEMORY = 4_000_000_000
"""Memory that a task may take, bytes: a hostile upload could unpack into any size."""
LONGEST = 600.0
"""Time that a task may take, s."""
OUT_OF_MEMORY = Path("/proc/self/oom_score_adj")
"""On Linux, 1000 in this file makes the kernel end this process first if memory runs out, before labs and the server."""
TOO_LARGE = (
    f"This takes more than {MOST_MEMORY / 1e9:g} GB of memory: choose a shorter range of time, or use the command line."
)
CLOSING = "This server is closing."
T = TypeVar("T")
log = logging.getLogger(__name__)


def _forks() -> bool:
    """Whether processes are forked: on Linux, if the path of the temporary folder leaves room for a socket's name."""
    return sys.platform == "linux" and len(os.fsencode(tempfile.gettempdir())) + SOCKET_NAME <= LONGEST_SOCKET


def job_processes() -> "ForkServerContext | SpawnContext":
    """The context that makes processes of labs and jobs: on Linux, forks of one process, which share its program in memory.

    Elsewhere forking is unsafe (macOS) or missing (Windows), and each process loads the program itself.
    """
    if not _forks():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([LAB_PROGRAM])
    return context


def prepare_lab_processes() -> None:
    """Start loading the labs' program, so that the first visitor waits no longer than the others."""
    job_processes()
    if _forks():
        with without_interrupt():
            forkserver.ensure_running()


@contextlib.contextmanager
def without_interrupt() -> Generator[None, None, None]:
    """Keep Ctrl-C from processes started meanwhile: a terminal sends it to all, but the server closes them in order."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Python's own helper process must be there already: starting it would let Ctrl-C through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def start(process: BaseProcess, *its_ends: Connection) -> None:
    """Start a process of `job_processes`, which Ctrl-C does not reach, and close its ends of pipes here."""
    with without_interrupt():
        process.start()
    for end in its_ends:
        end.close()


def leave_interrupts_to_the_server() -> None:
    """Ignore Ctrl-C and a closed terminal in this process: the server handles both."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


@contextlib.contextmanager
def failures_told_plainly() -> Generator[None, None, None]:
    """Print this process's traceback without control characters: it may quote what a visitor sent."""
    tell_failures_plainly()
    try:
        yield
    except Exception as error:
        sys.excepthook(type(error), error, error.__traceback__)
        sys.exit(1)


def work_for_the_server(niceness: int) -> None:
    """Have this job's process work at a Unix niceness, with a limited memory, and end with the server, however that ends."""
    leave_interrupts_to_the_server()
    give_way(niceness)
    limit_memory(MOST_MEMORY)
    with contextlib.suppress(OSError):
        OUT_OF_MEMORY.write_text("1000", encoding="ascii")
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, name="flexlab-parent", daemon=True).start()


@dataclass(frozen=True)
class Done:
    """The result of a task that has finished."""

    result: Any


Word = float | Done | LabError
"""A message from a task's process: the work's progress, 0 to 1, its result, or why it failed."""


@failures_told_plainly()
def carry_out(
    work: Callable[..., Any], arguments: tuple[Any, ...], niceness: int, own_laws: dict[str, str], pipe: Connection
) -> None:
    """The main function of a task's process."""
    know_own_files(own_laws)
    work_for_the_server(niceness)
    more = {"report": pipe.send} if "report" in inspect.signature(work).parameters else {}
    try:
        word: Done | LabError = Done(work(*arguments, **more))
    except FlexlabError as error:
        word = LabError(str(error))
    except MemoryError:
        word = LabError(TOO_LARGE)
    except FileNotFoundError as error:
        if not (gone := vanished(error)):
            raise
        word = LabError(gone)
    pipe.send(word)


@dataclass(frozen=True)
class Turn:
    """One turn of a task. `shown`, `long`: as for `Tasks.run`."""

    asker: Visitor
    shown: bool
    long: bool


class Turns:
    """The queue of tasks. One place is kept for the teacher, and one for tasks that no page shows, as a browser waits for them.

    A visitor runs one task at a time of those that a page shows, and one of the others.
    """

    def __init__(self) -> None:
        self._working: list[Turn] = []
        self._waiting: dict[asyncio.Future[None], Turn] = {}

    @contextlib.asynccontextmanager
    async def turn(self, asker: Visitor, shown: bool = False, long: bool = False) -> AsyncGenerator[None]:
        """Wait for a turn and hold it. `shown`, `long`: as for `Tasks.run`."""
        mine = asyncio.get_running_loop().create_future()
        self._waiting[mine] = turn = Turn(asker, shown, long)
        self._go_on()
        try:
            await mine
            yield
        finally:
            if self._waiting.pop(mine, None) is None:
                self._working.remove(turn)
            self._go_on()

    def _go_on(self) -> None:
        """Give free turns to the teacher first, then to addresses with the fewest turns, then in order of arrival."""
        while ready := [turn for turn, asked in self._waiting.items() if self._may_work(asked)]:
            turn = min(ready, key=lambda ready: self._rank(self._waiting[ready].asker))
            self._working.append(self._waiting.pop(turn))
            if not turn.done():  # A cancelled asker gives its turn back.
                turn.set_result(None)

    def _may_work(self, turn: Turn) -> bool:
        if len(self._working) >= AT_ONCE or (turn.long and any(other.long for other in self._working)):
            return False
        if turn.asker.is_teacher:
            return True
        visitors = [other for other in self._working if not other.asker.is_teacher]
        alike = [other for other in visitors if other.shown == turn.shown]
        taken = any(other.asker.person == turn.asker.person for other in alike)
        return not taken and len(visitors) < AT_ONCE - 1 and not (turn.shown and len(alike) >= AT_ONCE - 2)

    def _rank(self, asker: Visitor) -> tuple[bool, int]:
        return not asker.is_teacher, sum(other.asker.address == asker.address for other in self._working)


class Tasks:
    """All tasks of one server. To be used in its event loop only."""

    def __init__(self) -> None:
        self._limit = Limit("tasks", MOST_OF_ONE, MOST_OF_ADDRESS, MOST, MOST_OF_TEACHER)
        self._turns = Turns()
        self._processes: set[BaseProcess] = set()
        self._closed = False

    def check(self, asker: Visitor) -> None:
        """Raise `BusyError` if this asker may not start a task now."""
        self._limit.check(asker)

    async def run(
        self,
        asker: Visitor,
        work: Callable[..., T],
        *arguments: Any,
        on_progress: Callable[[float], None] = lambda share: None,
        shown: bool = False,
        long: bool = False,
    ) -> T:
        """Return the result of `work(*arguments)`, run in a process of its own; its `report`, if any, takes progress, 0 to 1.

        `shown`: a page shows its progress, and no browser waits for its result. `long`: only one runs at a time. Work, arguments
        and result must be picklable. The process ends when the caller is cancelled. Raises `FlexlabError` as `work` does,
        `BusyError` for too many tasks, and `LabError` if the process fails.
        """
        with self._limit.place(asker):
            async with self._turns.turn(asker, shown, long):
                on_progress(0.0)  # The wait is over, although the process takes a moment to start.
                try:
                    return await self._run(work, arguments, on_progress)
                except OSError as error:  # There is no handle, process or memory left.
                    raise LabError(
                        f"This task cannot begin ({error.strerror}): this machine has too much to do. Try again later."
                    ) from None

    async def run_unseen(self, work: Callable[..., T], *arguments: Any) -> T:
        """As `run`, for work of the server for which nobody waits: at once and of any length, at the lowest priority."""
        return await self._run(work, arguments, lambda share: None, LOWEST_PRIORITY, None)

    async def _run(
        self,
        work: Callable[..., T],
        arguments: tuple[Any, ...],
        on_progress: Callable[[float], None],
        niceness: int = LOW_PRIORITY,
        longest: float | None = LONGEST,
    ) -> T:
        if self._closed:  # Ending the running tasks gives the waiting ones their turn.
            raise LabError(CLOSING)
        context = job_processes()
        pipe, other = context.Pipe(duplex=False)
        process = context.Process(
            target=carry_out, args=(work, arguments, niceness, allowed(), other), name="flexlab-task", daemon=True
        )
        # In a thread: large arguments are handed over once the process is up, which takes seconds on a busy machine.
        starting = asyncio.ensure_future(asyncio.to_thread(start, process, other))
        self._processes.add(process)
        try:
            await asyncio.shield(starting)
            async with asyncio.timeout(longest):
                while isinstance(word := await asyncio.to_thread(_hear, pipe), float):
                    on_progress(word)
        except TimeoutError:
            raise LabError(f"This takes longer than {longest:g} s: use the command line instead.") from None
        finally:
            await asyncio.wait([starting])
            if starting.exception() is None:
                process.kill()
                await asyncio.shield(asyncio.to_thread(process.join))
            self._processes.discard(process)
        if isinstance(word, Done):
            return word.result
        if isinstance(word, LabError):
            raise word
        if self._closed:
            raise LabError(CLOSING)
        log.warning("A task ended unexpectedly (exit code %s).", process.exitcode)
        raise LabError(
            f"This task ended unexpectedly (exit code {process.exitcode}): the run may be damaged, or too large for this machine."
        )

    def close(self) -> None:
        """End all tasks at once."""
        self._closed = True
        for process in list(self._processes):
            if process.pid is not None:
                process.kill()


def _hear(pipe: Connection) -> Word | None:
    """The next message of a process; None if it ended without one."""
    try:
        return pipe.recv()
    except (EOFError, OSError):
        return None
