"""A text in a process of its own, as the lab sees it: its reports and end, late answers, the line at fault."""

import contextlib
import os
import re
import secrets
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path
from typing import NamedTuple

import msgspec

from flexlab.own.child import Report
from flexlab.own.reading import TextProblem
from flexlab.text import visible

PROBE = 0.02
"""Time between two checks of a late process, s: whether it works or waits for a processor."""
LOADING_LIMIT = 60.0
"""Time for a file to load, s: it may have to compile libraries."""
MOST_READ = 1_000_000
"""The most bytes of reports that are read at a time, and in one line."""
LONGEST_PROBLEM = 2000
"""Characters of a sentence from the process."""
ENDING_LIMIT = 5.0
"""Time for the process to end what its text started, s."""
PROGRAM = f"import sys; sys.path.append({str(Path(__file__).parents[2])!r}); from flexlab.own.child import main; main()"
"""What the process of a text runs; with -P, no file of the working folder replaces a module of Python."""
MARK = "FLEXLAB_OWN_TEXT"
"""Environment variable that marks all processes of a text."""
LINE_LIMIT, LONGEST_LINE_LIMIT = 0.3, 3.0
"""Time to find out which line a late process is in, s, without and with its waits for a processor."""
PROCESSES = Path("/proc")
"""Where Linux tells about processes."""
STARVED = 0.3
"""Share of a check spent waiting for a processor, above which the machine is late and not the text."""


class Look(NamedTuple):
    """The state of a process at an instant, as the system reports it."""

    time: float
    """Time of the monotonic clock, s."""
    worked: float
    """Time on a processor so far, s."""
    waited: float
    """Time in the queue for a processor so far, s, without the present wait."""
    is_runnable: bool
    """Whether it works, or would if a processor were free."""


class OwnProcess:
    """A text in a process of its own. An error in it ends that process and becomes a sentence; nothing else is harmed."""

    sort = ""
    """law or path."""
    output: int = subprocess.DEVNULL
    """File descriptor to which all texts print."""
    limit = patience = longest = 0.0
    """When a late answer is given up, s: after `limit` of uninterrupted work in the text itself; after `patience` of work, or
    `longest` in all, wherever the process is."""
    late = ""
    """The sentence about a late process, after its place."""
    running = kept = 1
    """Of one file's texts, the newest `running` keep their processes and the newest `kept` their sockets."""

    def __init__(self, source: str, file: str):
        """Start the process; `ensure` waits until it is ready."""
        self._source, self.file = source, file
        self._mark = secrets.token_hex(8)
        self._lock = threading.RLock()
        # Later processes get the same file descriptors, whose numbers kernels keep.
        self._calls, self._reports = socket.socket(socket.AF_UNIX), socket.socket(socket.AF_UNIX)
        self._open = contextlib.ExitStack()
        """Sockets and pipes, closed by `dispose` or with this object."""
        for one in (self._calls, self._reports):
            self._open.enter_context(one)
        weakref.finalize(self, self._open.close).atexit = False
        self._said, self._trace, self._heard = b"", "", 0
        self._process: subprocess.Popen[bytes] | None = None
        self._lifeline = -1
        self._worker = 0
        self.is_loaded = self.has_answered = False
        self._problem = self._warning = ""
        self._start()

    @property
    def problem(self) -> str:
        """The last problem, as a sentence; empty if there was none."""
        self._listen(0.0)
        return self._problem

    @property
    def warning(self) -> str:
        """The warning that the process reported, as a sentence; empty if there was none."""
        self._listen(0.0)
        return self._warning

    @property
    def is_ready(self) -> bool:
        """Whether a call is answered at once."""
        self._listen(0.0)
        return self._is_alive() and self.is_loaded and not self._problem

    def ensure(self) -> None:
        """Wait until the text is ready, in a new process if need be. Raises `TextProblem` for a text that cannot be run."""
        if self.problem or not self._is_alive():
            self._start_again()
        end = time.monotonic() + LOADING_LIMIT
        while not self.is_loaded and not self._problem:
            self._listen(PROBE)
            if not self.is_loaded and not self._problem and not self._is_alive():
                self._problem = self._how_it_ended()
            elif time.monotonic() > end and not self.is_loaded:
                self._problem = f"{self._name}{self._line()}: it was not loaded within {LOADING_LIMIT:g} s."
        if self._problem:
            problem = self._problem
            self.close()
            raise TextProblem(problem)

    def close(self, why: str = "") -> None:
        """End the process and all that its text started, from any thread; whoever waits for it to load gets a sentence."""
        if why:
            self._problem = f"{self._name}: {why}"
        process, self._process = self._process, None
        if process is None:
            return
        os.close(self._lifeline)
        if hasattr(signal, "SIGCONT"):
            process.send_signal(signal.SIGCONT)  # The text may have stopped its supervisor.
        try:
            process.wait(ENDING_LIMIT)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        if process.returncode == -getattr(signal, "SIGKILL", 0):
            # The supervisor was killed itself: what the text started is found by its mark.
            mark = f"{MARK}={self._mark}".encode()
            for process in PROCESSES.glob("[0-9]*"):
                with contextlib.suppress(OSError):
                    if mark in (process / "environ").read_bytes().split(b"\0"):
                        os.kill(int(process.name), signal.SIGKILL)

    def dispose(self) -> None:
        """End the process and close its sockets: nobody may ask any more."""
        self.close()
        self._open.close()

    @property
    def _name(self) -> str:
        return Path(self.file).name

    def _is_alive(self) -> bool:
        process = self._process
        return process is not None and process.poll() is None

    def _start_again(self) -> None:
        with self._lock:
            self._start()

    def _start(self) -> None:
        self.close()
        ours, theirs = socket.socketpair()
        reports, reporting = socket.socketpair()
        # One thread each: a text that multiplies small matrices must leave the lab its cores.
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        lifeline, self._lifeline = os.pipe()
        handed = theirs.fileno(), reporting.fileno(), lifeline
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", PROGRAM, *map(str, handed), self.file, self.sort],
            pass_fds=handed,
            env=os.environ | threads | {"PYTHONUNBUFFERED": "1", MARK: self._mark},
            stdin=subprocess.DEVNULL,
            stdout=self.output,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        theirs.close()
        reporting.close()
        os.close(lifeline)
        self._said, self._trace, self._problem = b"", "", ""
        self.is_loaded = self.has_answered = False
        self._worker = 0
        text = self._source.encode()
        with contextlib.suppress(OSError):  # A process that ended at once says why.
            ours.sendall(len(text).to_bytes(8, "little") + text)
        for new, kept in ((ours, self._calls), (reports, self._reports)):
            os.dup2(new.fileno(), kept.fileno(), inheritable=False)
            new.close()
        self._reports.setblocking(False)

    def _listen(self, patience: float) -> None:
        """Read the process's reports, and the tracebacks that it writes between them."""
        with self._lock:
            if patience:
                select.select([self._reports], [], [], patience)
            try:
                taken = 0
                while taken < MOST_READ and (data := self._reports.recv(65536)):
                    self._said += data
                    taken += len(data)
                    self._heard += len(data)
            except OSError:
                pass
            lines = self._said.split(b"\n")
            for line in lines[:-1]:
                if line.startswith(b"{"):
                    self._note(line)
                else:
                    self._trace = f"{self._trace}{line.decode(errors='replace')}\n"[:MOST_READ]
            self._said = lines[-1][:MOST_READ]

    def _note(self, line: bytes) -> None:
        with contextlib.suppress(ValueError, RecursionError):
            said = msgspec.json.decode(line, type=Report)
            self.is_loaded |= said.ready
            self.has_answered |= said.answered
            self._worker = self._worker or said.pid
            self._problem = self._problem or visible(said.problem, LONGEST_PROBLEM)
            self._warning = self._warning or visible(said.warning, LONGEST_PROBLEM)

    def _give_up(self, problem: str) -> bool:
        self._problem = self._problem or problem
        self.close()
        return False

    def _wait(self) -> bool:
        """Wait for a late answer; if none will come, give the process up and return False."""
        begin, worked, in_a_row = time.monotonic(), 0.0, 0.0
        while self._is_alive() and not self._problem:
            before, heard = self._look(), self._heard
            if self._has_answer(PROBE):
                return True
            self._listen(0.0)
            waited = self._waited(before)
            worked += max(0.0, time.monotonic() - before.time - waited)
            # A process that reports more than the socket holds waits until it is read. A check takes longer than PROBE if
            # this process itself waits for a processor, which says nothing about the other one.
            is_held_up = self._heard > heard or waited > STARVED * PROBE
            in_a_row = 0.0 if is_held_up else in_a_row + PROBE
            is_over = worked > self.patience or time.monotonic() - begin > self.longest
            if in_a_row > self.limit or is_over:
                line = self._line()
                if self._has_answer(0.0):
                    return True
                # Outside the text itself it is the machine that is slow.
                if line or is_over:
                    return self._give_up(f"{self._name}{line}: {self.late}")
        return self._give_up(self._problem or self._how_it_ended())

    def _has_answer(self, patience: float) -> bool:
        """Whether there are bytes to read; a closed socket means that the process has ended."""
        if not select.select([self._calls], [], [], patience)[0]:
            return False
        return bool(self._calls.recv(1, socket.MSG_PEEK)) or self._give_up(self._how_it_ended())

    def _look(self) -> Look:
        """The process now; where the system does not report waits, all time in which it does not work counts as one."""
        try:
            work, wait = (PROCESSES / f"{self._worker}/schedstat").read_text().split()[:2]
            state = (PROCESSES / f"{self._worker}/stat").read_text().rpartition(")")[2].split()[0]
        except (OSError, ValueError, IndexError):
            import psutil

            try:
                worked = sum(psutil.Process(self._worker).cpu_times()[:2])
            except psutil.Error:
                worked = 0.0
            now = time.monotonic()
            return Look(now, worked, now - worked, False)
        return Look(time.monotonic(), int(work) / 1e9, int(wait) / 1e9, state == "R")

    def _waited(self, since: Look) -> float:
        """Time that the process has waited for a processor since a look, s."""
        now = self._look()
        # Linux counts a wait only once it ends; until then the process is runnable and does no work.
        if now.is_runnable and since.is_runnable and now.worked == since.worked:
            return now.time - since.time
        return now.waited - since.waited

    def _line(self) -> str:
        """The text's present line, as in ", line 12"; empty if it cannot be found out."""
        process = self._process
        if process is None:
            return ""
        self._listen(0.0)
        self._trace = ""
        process.send_signal(signal.SIGUSR1)
        idle, end = 0.0, time.monotonic() + LONGEST_LINE_LIMIT
        while idle < LINE_LIMIT and time.monotonic() < end and self._is_alive():
            before = self._look()
            self._listen(PROBE)
            if found := self._traced_line():
                self._trace = ""
                return found
            idle += time.monotonic() - before.time - self._waited(before)
        return ""

    def _traced_line(self) -> str:
        found = re.search(rf'File "{re.escape(self.file)}", line (\d+)', self._trace)
        return f", line {found[1]}" if found else ""

    def _how_it_ended(self) -> str:
        """A sentence about a process that ended."""
        process = self._process
        if process is None:
            return self._problem or f"{self._name}: its process was ended."
        try:
            code = process.wait(LINE_LIMIT)
        except subprocess.TimeoutExpired:
            code = None
        self._listen(PROBE)
        if self._problem:
            return self._problem
        where = f"{self._name}{self._traced_line()}"
        if code is None:
            return f"{where}: it closed its connection to flexlab, or it does not end."
        return f"{where}: its process ended ({f'signal {-code}' if code < 0 else f'exit code {code}'})."
