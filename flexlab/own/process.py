"""A person's own file in a process of its own, as the lab holds it: reports, crashes, lateness, and the line at fault."""

import contextlib
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import NamedTuple

from flexlab.own.execution import TextProblem
from flexlab.text import visible

PROBE = 0.02
"""s over which a late process is looked at: whether it works, or waits for a processor that others have."""
LOADING_LIMIT = 60.0
"""s that a file may take until its class is there: libraries may have to be compiled."""
MOST_READ = 1_000_000
"""Bytes of reports that one look takes in, and that a line may have."""
LONGEST_PROBLEM = 2000
"""Characters of a sentence from the process."""
ENDING_LIMIT = 5.0
"""s for the process to end what its text started."""
LINE_LIMIT, LONGEST_LINE_LIMIT = 0.3, 3.0
"""s to wait for the line in which a late process is, without and with its own waits for a processor."""


class Look(NamedTuple):
    """What the system tells of a process at an instant."""

    time: float
    """s, of the monotonic clock."""
    worked: float
    """s on a processor so far."""
    waited: float
    """s in the queue for one so far, but for the wait that goes on."""
    is_runnable: bool
    """Whether it works, or would if a processor were free."""


class OwnProcess:
    """A text in a process of its own: what it does wrong ends that process with a sentence, and nothing else."""

    sort = ""
    """Of the text: law or path."""
    output: int = subprocess.DEVNULL
    """The file to which all texts print."""

    def __init__(self, source: str, file: str):
        """Starts the process; `ensure` waits until it is ready."""
        self._source, self._file = source, file
        self._lock = threading.RLock()
        self._calls = socket.socket(socket.AF_UNIX)  # holds a number that stays the same for all processes to come
        self._reports: socket.socket | None = None
        self._said, self._heard = b"", 0
        self._process: subprocess.Popen[bytes] | None = None
        self._lifeline = -1
        self._worker = 0
        self._is_loaded = False
        self._problem = ""
        self._start()

    @property
    def problem(self) -> str:
        """What went wrong last, as a sentence; empty: nothing."""
        self._listen(0.0)
        return self._problem

    @property
    def is_ready(self) -> bool:
        """Whether a call is answered at once."""
        self._listen(0.0)
        return self._is_alive() and self._is_loaded and not self._problem

    def ensure(self) -> None:
        """Be ready, in a new process if need be. Raises `TextProblem` for a text that cannot be run."""
        if self.problem or not self._is_alive():
            self._start_again()
        end = time.monotonic() + LOADING_LIMIT
        while not self._is_loaded and not self._problem:
            self._listen(PROBE)
            if not self._is_loaded and not self._problem and not self._is_alive():
                self._problem = self._how_it_ended()
            elif time.monotonic() > end and not self._is_loaded:
                self._problem = f"{self._name}{self._line()}: it was not loaded within {LOADING_LIMIT:g} s."
        if self._problem:
            problem = self._problem
            self.close()
            raise TextProblem(problem)

    def close(self) -> None:
        """End the process and all that its text started. Any thread may: who waits for it to load is told."""
        process, self._process = self._process, None
        if process is None:
            return
        os.close(self._lifeline)
        if hasattr(signal, "SIGCONT"):
            process.send_signal(signal.SIGCONT)  # The text may have stopped the one that is to end it.
        try:
            process.wait(ENDING_LIMIT)
        except subprocess.TimeoutExpired:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()

    def dispose(self) -> None:
        """End the process and give back its files: nobody may ask any more."""
        self.close()
        self._calls.close()
        if self._reports is not None:
            self._reports.close()

    def close_unless_loaded(self) -> None:
        """End a process that is not ready yet: nothing is to wait for it any more."""
        if not self._is_loaded:
            self.close()

    @property
    def _name(self) -> str:
        return Path(self._file).name

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
        self._prepare(ours)
        command = [sys.executable, "-m", "flexlab.own.child"]
        # One thread each: a text that multiplies small matrices must not take all cores from the lab.
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        lifeline, self._lifeline = os.pipe()
        handed = theirs.fileno(), reporting.fileno(), lifeline
        self._process = subprocess.Popen(
            [*command, *map(str, handed), self._file, self.sort],
            pass_fds=handed,
            env=os.environ | threads | {"PYTHONUNBUFFERED": "1"},
            stdin=subprocess.DEVNULL,
            stdout=self.output,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        theirs.close()
        reporting.close()
        os.close(lifeline)
        self._reports, self._said, self._problem, self._is_loaded = reports, b"", "", False
        self._worker = 0
        reports.setblocking(False)
        text = self._source.encode()
        with contextlib.suppress(OSError):  # A process that ended at once says why.
            ours.sendall(len(text).to_bytes(8, "little") + text)
        os.dup2(ours.fileno(), self._calls.fileno(), inheritable=False)
        ours.close()

    def _prepare(self, calls: socket.socket) -> None:
        """Options of a new socket for calls."""

    def _listen(self, patience: float) -> str:
        """Take note of what the process reports; returns what is no report of its own: the lines of its crash or stall."""
        reports = self._reports
        if reports is None:
            return ""
        with self._lock:
            if patience:
                select.select([reports], [], [], patience)
            try:
                taken = 0
                while taken < MOST_READ and (data := reports.recv(65536)):
                    self._said += data
                    taken += len(data)
                    self._heard += len(data)
            except OSError:
                pass
            lines = self._said.split(b"\n")
            other = []
            for line in lines[:-1]:
                if line.startswith(b"{"):
                    self._note(line)
                else:
                    other.append(line.decode(errors="replace"))
            self._said = lines[-1][:MOST_READ]
            return "\n".join(other)

    def _note(self, line: bytes) -> None:
        try:
            said = json.loads(line)
        except (ValueError, RecursionError):
            return
        if not isinstance(said, dict):
            return
        if said.get("ready") is True:
            self._is_loaded = True
        elif isinstance(said.get("pid"), int):
            self._worker = self._worker or said["pid"]
        elif isinstance(said.get("problem"), str):
            self._problem = self._problem or visible(said["problem"], LONGEST_PROBLEM)

    def _gave_up(self, problem: str) -> bool:
        self._problem = self._problem or problem
        self.close()
        return False

    def _look(self) -> Look:
        """How the process stands now; nothing is known where the system does not tell."""
        try:
            work, wait = Path(f"/proc/{self._worker}/schedstat").read_text().split()[:2]
            state = Path(f"/proc/{self._worker}/stat").read_text().rpartition(")")[2].split()[0]
        except (OSError, ValueError, IndexError):
            return Look(time.monotonic(), 0.0, 0.0, False)
        return Look(time.monotonic(), int(work) / 1e9, int(wait) / 1e9, state == "R")

    def _waited(self, since: Look) -> float:
        """s that the process has waited for a processor since a look."""
        now = self._look()
        # Linux counts a wait when it ends: one that goes on is seen by who could work and does not.
        if now.is_runnable and since.is_runnable and now.worked == since.worked:
            return now.time - since.time
        return now.waited - since.waited

    def _line(self) -> str:
        """Where the text is now, as in ", line 12"; empty if it cannot be found out."""
        process = self._process
        if process is None:
            return ""
        self._listen(0.0)
        process.send_signal(signal.SIGUSR1)
        idle, text, end = 0.0, "", time.monotonic() + LONGEST_LINE_LIMIT
        while idle < LINE_LIMIT and time.monotonic() < end and self._is_alive():
            before = self._look()
            text += self._listen(PROBE)
            if found := self._line_in(text):
                return found
            idle += time.monotonic() - before.time - self._waited(before)
        return ""

    def _line_in(self, text: str) -> str:
        found = re.search(rf'File "{re.escape(self._file)}", line (\d+)', text)
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
        text = self._listen(PROBE)
        if self._problem:
            return self._problem
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        return f"{self._name}{self._line_in(text)}: its process ended ({how})."
