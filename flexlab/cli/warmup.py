"""The first start on a machine compiles the engine: say so, show that something happens."""

import os
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext

from flexlab.cli.console import EXIT_INTERRUPTED, note, notes
from flexlab.scenario import Scenario


def warm_up(scenario: Scenario, meanwhile: AbstractContextManager[object] | None = None) -> None:
    """Have the engine compiled; if that takes long, tell the person and hold `meanwhile` open until it is done."""
    from flexlab.compiled import COMPILATION, COMPILING
    from flexlab.sim.world import World

    with ExitStack() as shown, _ending_at_once():

        def tell() -> None:
            note(COMPILING)
            shown.callback(note, "Compiled.")
            for each in (meanwhile or nullcontext(), _wheel()):
                shown.enter_context(each)

        shown.callback(setattr, COMPILATION, "tell", COMPILATION.tell)
        COMPILATION.tell = tell
        # One sample period of simulation goes through every kernel.
        World(scenario).run(1)


@contextmanager
def _ending_at_once() -> Generator[None]:
    """Meanwhile, Ctrl-C ends the process, which has nothing to save: within the compiler, Python may lose an exception."""

    def end(*_: object) -> None:
        notes().show_cursor()
        # Not by the console, which may be in the middle of a sentence.
        os.write(2, b"Interrupted: the next start compiles what is missing.\n")
        os._exit(EXIT_INTERRUPTED)

    before = signal.signal(signal.SIGINT, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def compiling_the_rest() -> Generator[None]:
    """Meanwhile, have a process of its own compile what the first picture did not need, if that was never done."""
    from flexlab.sim.compile_all import WHILE_OPEN, is_everything_compiled

    if is_everything_compiled():
        yield
        return
    nowhere = subprocess.DEVNULL
    program = [sys.executable, "-m", "flexlab.sim.compile_all", WHILE_OPEN]
    # A lab that is killed closes the pipe, too: nothing is left that takes a core for a minute.
    process = subprocess.Popen(program, stdin=subprocess.PIPE, stdout=nowhere, stderr=nowhere)
    try:
        yield
    finally:
        process.terminate()
        process.communicate()


def _wheel() -> AbstractContextManager[object]:
    """A turning wheel with the seconds so far, if somebody looks at a terminal."""
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    if not notes().is_terminal:
        return nullcontext()
    columns = SpinnerColumn(), TextColumn("compiling"), TimeElapsedColumn()
    progress = Progress(*columns, console=notes(), transient=True)
    progress.add_task("compiling", total=None)
    return progress
