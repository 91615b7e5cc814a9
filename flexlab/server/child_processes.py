"""What every process that the server starts has in common."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Generator
from multiprocessing import resource_tracker
from multiprocessing.connection import wait


@contextlib.contextmanager
def without_interrupt() -> Generator[None, None, None]:
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


def end_with_the_server() -> None:
    """In the process itself: when the server is killed, nobody waits for this work any more."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, name="flexlab-parent", daemon=True).start()
