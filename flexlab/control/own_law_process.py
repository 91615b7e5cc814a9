"""A control law in Python in a process of its own, as the lab holds it: calls, lateness, crashes, and the line at fault."""

import json
import os
import re
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

from flexlab.control.own_law_channel import AnswerFunction, Channel, address_of, message_at
from flexlab.own_laws.execution import LawProblem
from flexlab.own_laws.message import FAILED, OUTCOME, WAIT

ANSWER_LIMIT = 0.05
"""s until an answer counts as late: fifty control periods of 1 ms."""
PROBE = 0.02
"""s over which a late process is looked at: whether it works, or waits for a processor that others have."""
PATIENCE = 2.0
"""s after which a late answer is given up however busy the machine is."""
PROBES = 2
"""Looks in a row at a process that could work, after which it is asked for its line."""
STARVED = 0.3
"""Share of the time without a processor from which on lateness is the machine's, not the law's."""
LOADING_LIMIT = 60.0
"""s that a file may take until its law is there: libraries may have to be compiled."""
LINE_LIMIT = 0.3
"""s to wait for the line in which a late law is."""
TURN = b"\0"
"""The byte that says whose turn it is to ask."""


class Apart:
    """A law in a process of its own: what it does wrong ends a run with a sentence, and nothing else."""

    def __init__(self, source: str, file: str):
        """Starts the process; `ensure` waits until it is ready."""
        self._source, self._file = source, file
        self._lock = threading.RLock()
        self._calls = socket.socket(socket.AF_UNIX)  # holds a number that stays the same for all processes to come
        self._reports: socket.socket | None = None
        self._said = b""
        self._process: subprocess.Popen[bytes] | None = None
        self._is_loaded = False
        self._turn = os.pipe()
        """One byte goes through it: who has it may ask."""
        os.write(self._turn[1], TURN)
        self._late_function = AnswerFunction(self._late)
        self.channel = Channel(0, address_of(self._late_function), self._calls.fileno(), *self._turn)
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
        """Be ready for a run, in a new process if need be. Raises `LawProblem` for a text that cannot be run."""
        if self.problem or not self._is_alive():
            turn = os.read(self._turn[0], 1)
            try:
                with self._lock:
                    self._start()
            finally:
                os.write(self._turn[1], turn)
        with self._lock:
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
                raise LawProblem(problem)

    def close(self) -> None:
        """End the process."""
        with self._lock:
            if self._process is not None:
                self._process.kill()
                self._process.wait()
                self._process = None

    @property
    def _name(self) -> str:
        return Path(self._file).name

    def _is_alive(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def _start(self) -> None:
        self.close()
        ours, theirs = socket.socketpair()
        reports, reporting = socket.socketpair()
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 0, int(1e6 * ANSWER_LIMIT)))
        command = [sys.executable, "-m", "flexlab.own_laws.child"]
        # One thread each: a law that multiplies small matrices must not take all cores from the lab.
        threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        handed = theirs.fileno(), reporting.fileno()
        self._process = subprocess.Popen(
            [*command, *map(str, handed), self._file],
            pass_fds=handed,
            env=os.environ | threads,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        theirs.close()
        reporting.close()
        self._reports, self._said, self._problem, self._is_loaded = reports, b"", "", False
        reports.setblocking(False)
        text = self._source.encode()
        ours.sendall(len(text).to_bytes(8, "little") + text)
        os.dup2(ours.fileno(), self._calls.fileno(), inheritable=False)
        ours.close()

    def _listen(self, patience: float) -> str:
        """Take note of what the process reports; returns what is no report of its own: the lines of its crash or stall."""
        reports = self._reports
        if reports is None:
            return ""
        with self._lock:
            if patience:
                select.select([reports], [], [], patience)
            try:
                while data := reports.recv(65536):
                    self._said += data
            except OSError:
                pass
            lines = self._said.split(b"\n")
            other = []
            for line in lines[:-1]:
                if line.startswith(b"{"):
                    self._note(line)
                else:
                    other.append(line.decode(errors="replace"))
            self._said = lines[-1]
            return "\n".join(other)

    def _note(self, line: bytes) -> None:
        try:
            said = json.loads(line)
        except ValueError:
            return
        if said.get("ready"):
            self._is_loaded = True
        elif not self._problem:
            self._problem = str(said.get("problem", ""))

    def _late(self, message: int, _: int) -> None:
        """Whether to wait on for an answer; if not, why, and the process ends."""
        outcome = message_at(message)
        try:
            outcome[OUTCOME] = WAIT if self._is_worth_waiting() else FAILED
        except Exception as error:
            outcome[OUTCOME], self._problem = FAILED, f"{self._name}: {type(error).__name__}: {error}."

    def _is_worth_waiting(self) -> bool:
        """Whether the answer came after all. Given up is a law that could work and is still at it, or anything after long."""
        end, probes = time.monotonic() + PATIENCE, 0
        while self._is_alive() and not self._problem:
            before = self._waited()
            if self._has_answer(PROBE):
                return True
            if self._problem:
                return False
            probes = 0 if self._waited() - before > STARVED * PROBE else probes + 1
            late = time.monotonic() > end
            if probes < PROBES and not late:
                continue
            line = self._line()
            if self._has_answer(0.0):
                return True
            # Where it is not in the law's own text, the machine is what is slow.
            if line or late:
                return self._gave_up(f"{self._name}{line}: act did not answer within {1e3 * ANSWER_LIMIT:g} ms.")
        return self._gave_up(self._problem or self._how_it_ended())

    def _has_answer(self, patience: float) -> bool:
        """Whether an answer, or the end of the process, is there to be read."""
        if not select.select([self._calls], [], [], patience)[0]:
            return False
        return bool(self._calls.recv(1, socket.MSG_PEEK)) or self._gave_up(self._how_it_ended())

    def _gave_up(self, problem: str) -> bool:
        self._problem = self._problem or problem
        self.close()
        return False

    def _waited(self) -> float:
        """s that the process has waited for a processor; 0 where the system does not tell."""
        try:
            pid = self._process.pid if self._process is not None else 0
            return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
        except (OSError, ValueError, IndexError):
            return 0.0

    def _line(self) -> str:
        """Where the law is now, as in ", line 12"; empty if it cannot be found out."""
        if self._process is None:
            return ""
        self._listen(0.0)
        self._process.send_signal(signal.SIGUSR1)
        end, text = time.monotonic() + LINE_LIMIT, ""
        while time.monotonic() < end and self._is_alive():
            text += self._listen(PROBE)
            if found := self._line_in(text):
                return found
        return ""

    def _line_in(self, text: str) -> str:
        found = re.search(rf'File "{re.escape(self._file)}", line (\d+)', text)
        return f", line {found[1]}" if found else ""

    def _how_it_ended(self) -> str:
        """A sentence about a process that ended."""
        try:
            code = self._process.wait(LINE_LIMIT) if self._process is not None else None
        except subprocess.TimeoutExpired:
            code = None
        text = self._listen(PROBE)
        if self._problem:
            return self._problem
        how = f"signal {-code}" if code is not None and code < 0 else f"exit code {code}"
        return f"{self._name}{self._line_in(text)}: its process ended ({how})."
