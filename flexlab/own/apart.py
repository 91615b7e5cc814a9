"""A law or a path in a process of its own: how it is asked."""

import ctypes
import os
import socket
import struct
from collections.abc import Generator

import numpy as np

from flexlab.own.execution import ANSWERED, FAILED, Channel, address_of
from flexlab.own.process import PROBE, OwnProcess
from flexlab.own.reading import TextProblem

ANSWER_LIMIT, LATE_LIMIT = 0.05, 0.03
"""s until a law's answer is late, fifty control periods of 1 ms; and s of work in a row after that until it is given up."""
POSES_LIMIT = 1.0
"""s until a path's poses are late, a fifth of a millisecond for each."""
LateFunction = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
"""C function of a message's address: whether its answer may still come."""
TURN = b"\0"
"""The byte that whoever asks a law takes and gives back."""


class LawApart(OwnProcess):
    """A control law in a process of its own, which kernels ask through a socket without Python's global lock."""

    sort, limit, patience, longest = "law", LATE_LIMIT, 2.0, 10.0
    running, kept = 3, 16
    """Running: the text in use, one that was refused, and the next one."""
    late = f"act did not answer within {1e3 * ANSWER_LIMIT:g} ms."

    def __init__(self, source: str, file: str):
        """Starts the process; `ensure` waits until it is ready."""
        super().__init__(source, file)
        self._turn = os.pipe()
        """One byte goes through it; whoever has it may ask."""
        os.write(self._turn[1], TURN)
        for end in self._turn:
            self._open.callback(os.close, end)
        self._is_interrupted = False
        outcomes = self._when_late()
        next(outcomes)
        self._late_function = LateFunction(outcomes.send)
        self.channel = Channel(0, address_of(self._late_function), self._calls.fileno(), *self._turn)

    def _start_again(self) -> None:
        turn = os.read(self._turn[0], 1)
        try:
            super()._start_again()
        finally:
            os.write(self._turn[1], turn)

    def _start(self) -> None:
        super()._start()
        self._calls.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("ll", 0, int(1e6 * ANSWER_LIMIT)))

    @property
    def problem(self) -> str:
        """What went wrong last, as a sentence; empty if nothing did. Raises, once, the KeyboardInterrupt that ended a call."""
        if self._is_interrupted:
            self._is_interrupted = False
            raise KeyboardInterrupt
        return super().problem

    def _when_late(self) -> Generator[int, int]:
        """Tells the kernel, each time that it asks, whether to wait on for an answer.

        Ctrl-C ends the kernel's reading, and Python raises it where it goes on: here within the `try`, in a function before it.
        """
        outcome = FAILED
        while True:
            try:
                yield outcome
                outcome = ANSWERED if self._wait() else FAILED
            except KeyboardInterrupt:
                # The caller is machine code, which would drop it: the run ends, and whoever asks why gets it.
                self._is_interrupted, outcome = True, FAILED
            except Exception as error:
                self._problem, outcome = f"{self._name}: {type(error).__name__}: {error}.", FAILED


class PathApart(OwnProcess):
    """A path in a process of its own."""

    sort, limit, patience, longest = "path", POSES_LIMIT, POSES_LIMIT, 15.0
    late = f"position took longer than {POSES_LIMIT:g} s for its poses."

    def poses(self, options: np.ndarray, shares: np.ndarray) -> tuple[float, np.ndarray]:
        """As `RunningPath.poses`."""
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
                raise TextProblem(problem or f"{self._name}: it answered with what are no poses.")
        return float(answer[0]), answer[1:].reshape(-1, 3).copy()

    def _received(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            if not self._wait():
                raise TextProblem(self._problem)
            data += self._calls.recv(size - len(data))
        return data
