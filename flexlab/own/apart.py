"""A law, and a path, in a process of its own: calls, and answers that are late."""

import os
import select
import socket
import struct
import time

import numpy as np

from flexlab.own import child
from flexlab.own.execution import FAILED, OUTCOME, WAIT, AnswerFunction, Channel, TextProblem, address_of, message_at
from flexlab.own.process import PROBE, OwnProcess

ANSWER_LIMIT = 0.05
"""s until an answer counts as late: fifty control periods of 1 ms."""
PATIENCE = 2.0
"""s after which a late answer is given up, wherever the law is."""
LONGEST_PATIENCE = 10.0
"""s after which it is given up however busy the machine is."""
PROBES = 2
"""Looks in a row at a process that could work, after which it is asked for its line."""
STARVED = 0.3
"""Share of the time without a processor from which on lateness is the machine's, not the law's."""
POSES_LIMIT = 1.0
"""s, without those for which the machine was busy elsewhere, until poses count as late: a fifth of a millisecond for each."""
POSES_PATIENCE = 15.0
"""s after which late poses are given up however busy the machine is."""
TURN = b"\0"
"""The byte that says whose turn it is to ask."""


class LawApart(OwnProcess):
    """A law in a process of its own: what it does wrong ends a run with a sentence, and nothing else."""

    sort = "law"

    def __init__(self, source: str, file: str):
        """Starts the process; `ensure` waits until it is ready."""
        super().__init__(source, file)
        self._turn = os.pipe()
        """One byte goes through it: who has it may ask."""
        os.write(self._turn[1], TURN)
        self._late_function = AnswerFunction(self._late)
        self.channel = Channel(0, address_of(self._late_function), self._calls.fileno(), *self._turn)

    def dispose(self) -> None:
        """As above; no kernel may ask any more."""
        super().dispose()
        for end in self._turn:
            os.close(end)

    def _start_again(self) -> None:
        turn = os.read(self._turn[0], 1)
        try:
            super()._start_again()
        finally:
            os.write(self._turn[1], turn)

    def _prepare(self, calls: socket.socket) -> None:
        calls.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 0, int(1e6 * ANSWER_LIMIT)))

    def _late(self, message: int, _: int) -> None:
        """Whether to wait on for an answer; if not, why, and the process ends."""
        outcome = message_at(message)
        try:
            outcome[OUTCOME] = WAIT if self._is_worth_waiting() else FAILED
        except Exception as error:
            outcome[OUTCOME], self._problem = FAILED, f"{self._name}: {type(error).__name__}: {error}."

    def _is_worth_waiting(self) -> bool:
        """Whether the answer came after all. Given up is a law that could work and is still at it, or anything after long."""
        begin, probes = time.monotonic(), 0
        while self._is_alive() and not self._problem:
            before, heard = self._look(), self._heard
            if self._has_answer(PROBE):
                return True
            self._listen(0.0)  # Who writes more reports than the socket holds is held up until they are read.
            if self._problem:
                return False
            is_held_up = self._heard > heard or self._waited(before) > STARVED * PROBE
            probes = 0 if is_held_up else probes + 1
            late = time.monotonic() - begin > (LONGEST_PATIENCE if is_held_up else PATIENCE)
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


class PathApart(OwnProcess):
    """A path in a process of its own: what it does wrong is a sentence, and nothing else."""

    sort = "path"

    def poses(self, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
        """As `RunningPath.poses`, within `POSES_LIMIT`."""
        self.ensure()
        with self._lock:
            sizes = np.array([len(options), len(shares)], np.int64)
            try:
                self._calls.sendall(sizes.tobytes() + np.concatenate([options, shares]).tobytes())
                count = int(np.frombuffer(self._received(8), np.int64)[0])
                if count not in (child.FAILED, len(shares)):
                    raise self._over(f"{self._name}: it answered with {count} poses where {len(shares)} are due.")
                if count == child.FAILED:
                    self._listen(PROBE)
                    problem, self._problem = self._problem, ""
                    raise TextProblem(problem)
                answer = np.frombuffer(self._received(8 * (1 + 3 * count)), float)
            except OSError:
                raise self._over(self._how_it_ended()) from None
        return float(answer[0]), answer[1:].reshape(count, 3).copy()

    def _received(self, size: int) -> bytes:
        data, worked, end = b"", 0.0, time.monotonic() + POSES_PATIENCE
        while len(data) < size:
            before = self._look()
            if select.select([self._calls], [], [], PROBE)[0]:
                part = self._calls.recv(size - len(data))
                if not part:
                    raise self._over(self._how_it_ended())
                data += part
                continue
            worked += max(0.0, time.monotonic() - before.time - self._waited(before))
            if worked > POSES_LIMIT or time.monotonic() > end:
                problem = f"{self._name}{self._line()}: position took longer than {POSES_LIMIT:g} s for its poses."
                raise self._over(problem)
        return data

    def _over(self, problem: str) -> TextProblem:
        self._gave_up(problem)
        return TextProblem(self._problem)
