"""Ends calls that never return, of a person's text that runs in the process that uses flexlab."""

import ctypes
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

LONGEST_CALL = 10.0
"""Processor time that one call may take, s; a pause in a debugger takes none."""
LOOK = 0.25
"""Time between two checks of the calls in progress, s."""


class EndlessCall(BaseException):
    """Raised within a call that has used up `LONGEST_CALL`."""

    def __str__(self) -> str:
        return f"one call took more than {LONGEST_CALL:g} s of processor time"


class CallWatch:
    """The calls in progress. It needs the processor time of each thread, which Linux reports and macOS does not."""

    def __init__(self) -> None:
        self._calls: dict[int, tuple[int, float]] = {}
        """Thread → the clock of its processor time, and that clock's reading when the call began, s."""
        self._thread: threading.Thread | None = None

    @contextmanager
    def call(self) -> Iterator[None]:
        """Watch one call of this thread: raise `EndlessCall` in it after `LONGEST_CALL`."""
        if not hasattr(time, "pthread_getcpuclockid"):
            yield
            return
        if self._thread is None or not self._thread.is_alive():  # Threads do not survive a fork.
            self._thread = threading.Thread(target=self._look, daemon=True, name="flexlab-calls")
            self._thread.start()
        me = threading.get_ident()
        self._calls[me] = time.pthread_getcpuclockid(me), time.thread_time()
        try:
            yield
        finally:
            self._calls.pop(me, None)

    def _look(self) -> None:
        while True:
            time.sleep(LOOK)
            for thread, call in list(self._calls.items()):
                clock, begin = call
                try:
                    worked = time.clock_gettime(clock) - begin
                except OSError:  # The thread has ended.
                    continue
                if worked > LONGEST_CALL and self._calls.get(thread) is call:
                    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(EndlessCall))


CALLS = CallWatch()
