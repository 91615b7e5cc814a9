"""What every process that the server starts has in common."""

import contextlib
import signal
from collections.abc import Iterator
from multiprocessing import resource_tracker


@contextlib.contextmanager
def without_interrupt() -> Iterator[None]:
    """Keep Ctrl-C from processes started meanwhile: it reaches all of a terminal, but the server closes them, in order."""
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


def leave_interrupts_to_the_server() -> None:
    """In the process itself: a closed terminal, too, is for the server to answer."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
