"""How the server starts the processes of labs and jobs, and what these have in common."""

import contextlib
import multiprocessing
import os
import signal
import sys
import tempfile
import threading
from collections.abc import Generator
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import wait
from typing import TYPE_CHECKING

from flexlab.text import tell_failures_plainly

if TYPE_CHECKING:
    from multiprocessing.context import ForkServerContext, SpawnContext

LAB_PROGRAM = "flexlab.server.labs.preloaded"
"""The module that the process has imported from which labs and jobs are forked."""
LONGEST_SOCKET = 107
"""Bytes of a socket's path on Linux."""
SOCKET_NAME = 40
"""Bytes that Python's server of forks adds to the folder of temporary files: a folder of its own, and the socket's name."""


def _forks() -> bool:
    """Whether processes are forked: on Linux, if the folder of temporary files leaves room for the name of a socket."""
    return sys.platform == "linux" and len(os.fsencode(tempfile.gettempdir())) + SOCKET_NAME <= LONGEST_SOCKET


def job_processes() -> "ForkServerContext | SpawnContext":
    """Makes processes of labs and jobs. On Linux they are forked off one that has the whole program in memory, shared by all.

    Elsewhere forking is not safe (macOS) or not to be had (Windows): there each reads the program for itself.
    """
    if not _forks():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([LAB_PROGRAM])
    return context


def prepare_lab_processes() -> None:
    """Start reading the labs' program into memory, so that the first visitor waits no longer than the others."""
    job_processes()
    if _forks():
        with without_interrupt():
            forkserver.ensure_running()


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
    """Called in the process itself: the server answers Ctrl-C and a closed terminal."""
    for name in ("SIGINT", "SIGHUP"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


@contextlib.contextmanager
def failures_told_plainly() -> Generator[None, None, None]:
    """Used in the process itself: a traceback may quote what a visitor sent, so it is printed without control characters."""
    tell_failures_plainly()
    try:
        yield
    except Exception as error:
        sys.excepthook(type(error), error, error.__traceback__)
        sys.exit(1)


def end_with_the_server() -> None:
    """Called in the process itself: end when the server is killed, as nobody waits for the result."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=watch, name="flexlab-parent", daemon=True).start()
