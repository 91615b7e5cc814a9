"""What a start can be spared, and what takes its time at the first: modules that nobody asks, and the engine's compilation."""

import gc
import os
import signal
import subprocess
import sys
from collections.abc import Generator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from typing import TYPE_CHECKING, Any

from flexlab.cli.console import EXIT_INTERRUPTED, note, notes

if TYPE_CHECKING:
    from flexlab.scenario import Scenario

UNASKED = frozenset({"numpy.f2py", "yaml", "rerun.experimental", "rerun.server", "rerun.urdf"})
"""Modules that scipy, numba and rerun load in case somebody asks something of them, a twelfth of a start: no command does."""


class _Later:
    """Finds these modules as all others, but has each read when something is asked of it."""

    def find_spec(self, name: str, path: Sequence[str] | None, target: Any = None, /) -> ModuleSpec | None:
        """As of `importlib.abc.MetaPathFinder`."""
        spec = PathFinder.find_spec(name, path, target) if name in UNASKED else None
        if spec is not None and spec.loader is not None:
            spec.loader = LazyLoader(spec.loader)
        return spec


@contextmanager
def loading() -> Generator[None, None, None]:
    """While modules load, no garbage is looked for, and never again among what they have made: that is a tenth of a start.

    For processes that are the command line's own.
    """
    later = _Later()
    sys.meta_path.insert(0, later)
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
        sys.meta_path.remove(later)


def warm_up(scenario: "Scenario", meanwhile: AbstractContextManager[object] | None = None) -> None:
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
