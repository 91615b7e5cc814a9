"""Ends calls that never return, of a person's text that runs in the process that uses flexlab."""

import ctypes
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

LONGEST_CALL = 10.0
"""Processor time that one call may take, s; a pause in a debugger takes none."""
NEXT_CALL = 1.0
"""The same in a study in which another call of the same text has taken `LONGEST_CALL`: it may have many runs."""
LOOK = 0.25
"""Time between two checks of the calls in progress, s."""


class EndlessCall(BaseException):
    """Raised within a call that has used up `LONGEST_CALL`."""

    def __str__(self) -> str:
        return f"one call took more than {LONGEST_CALL:g} s of processor time"


class AnotherEndlessCall(EndlessCall):
    """Raised within a call that has used up `NEXT_CALL`."""

    def __str__(self) -> str:
        return (
            f"one call took more than {NEXT_CALL:g} s of processor time, and one before it more than {LONGEST_CALL:g} s"
        )


class CallWatch:
    """The calls in progress. It needs the processor time of each thread, which Linux reports and macOS does not."""

    def __init__(self) -> None:
        self._calls: dict[int, tuple[str, int, float]] = {}
        """Thread → text, the clock of its processor time, and that clock's reading when the call began, s."""
        self._ended: set[str] | None = None
        """The texts of which a call of the present study was ended; None outside of studies."""
        self._thread: threading.Thread | None = None

    @contextmanager
    def study(self) -> Iterator[None]:
        """Within the block, give a text of which one call was ended `NEXT_CALL` only for each of the others."""
        before, self._ended = self._ended, set()
        try:
            yield
        finally:
            self._ended = before

    @contextmanager
    def call(self, text: str) -> Iterator[None]:
        """Watch one call of a text by this thread: raise `EndlessCall` in it once it has taken too long."""
        if not hasattr(time, "pthread_getcpuclockid"):
            yield
            return
        if self._thread is None or not self._thread.is_alive():  # Threads do not survive a fork.
            self._thread = threading.Thread(target=self._look, daemon=True, name="flexlab-calls")
            self._thread.start()
        me = threading.get_ident()
        self._calls[me] = text, time.pthread_getcpuclockid(me), time.thread_time()
        try:
            yield
        finally:
            self._calls.pop(me, None)

    def _look(self) -> None:
        while True:
            time.sleep(LOOK)
            for thread, call in list(self._calls.items()):
                text, clock, begin = call
                try:
                    worked = time.clock_gettime(clock) - begin
                except OSError:  # The thread has ended.
                    continue
                ended = self._ended
                error = EndlessCall if worked > LONGEST_CALL else AnotherEndlessCall
                limit = LONGEST_CALL if ended is None or text not in ended else NEXT_CALL
                if worked > limit and self._calls.get(thread) is call:
                    if ended is not None:
                        ended.add(text)
                    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(error))


CALLS = CallWatch()
