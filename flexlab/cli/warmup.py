"""Faster loading of modules, and the compilation of the engine at the first start."""

import gc
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from flexlab.cli.console import note, notes
from flexlab.interrupts import answering

if TYPE_CHECKING:
    from flexlab.scenario import Scenario

UNUSED = 30 * 86400.0
"""Time after which machine code (83 MB per version) counts as unused, s. Systems update access times at least once a day."""
UNIT_DIGITS = 32
"""Hexadecimal digits in the name of a functional mock-up unit's folder, see `flexlab.own.unit_at_work`."""


@contextmanager
def loading() -> Generator[None, None, None]:
    """Suspend garbage collection while modules load, and exempt their objects from it; keep pandas out of pyarrow.

    This saves a tenth of a start, and a fifth where pandas is installed. Only for processes of the command line.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
    if "pyarrow" in sys.modules:
        from flexlab.recording import leave_pandas_out

        leave_pandas_out()


def warm_up(scenario: "Scenario", meanwhile: AbstractContextManager[object] | None = None) -> None:
    """Compile the engine; if that takes long, tell the person and stay in the context `meanwhile` until the end."""
    from flexlab.compiled import COMPILATION, COMPILING, cache_folder
    from flexlab.files import writable
    from flexlab.sim.world import World

    kernels = cache_folder()
    with (
        ExitStack() as shown,
        _ending_at_once(),
        writable(kernels, "make room, or set XDG_CACHE_HOME to another folder"),
    ):

        def tell() -> None:
            remove_unused(kernels)
            note(COMPILING)
            shown.callback(note, "Compiled.")
            for each in (meanwhile or nullcontext(), _wheel()):
                shown.enter_context(each)

        shown.callback(setattr, COMPILATION, "tell", COMPILATION.tell)
        COMPILATION.tell = tell
        # A sample period of simulation calls every kernel.
        World(scenario).run(1)


def remove_unused(kernels: Path) -> None:
    """Remove machine code of other versions, units and own texts, beside `kernels`, that nothing has read for `UNUSED`."""
    from flexlab.own.modules import OWN_TEXTS

    digit, beside = "[0-9a-f]", kernels.parent
    versions = beside.glob(f"kernels-{len(kernels.name.partition('-')[2]) * digit}")
    units = *beside.glob(f"unit-{UNIT_DIGITS * digit}"), *beside.glob("unit-draft-*")
    for folder in (*versions, *units, *(beside / OWN_TEXTS).glob("*")):
        with suppress(OSError):  # Another process may be removing it too.
            files = [file.stat() for file in folder.rglob("*") if file.is_file()]
            last = max((max(file.st_atime, file.st_mtime) for file in files), default=math.inf)
            if folder != kernels and not folder.is_symlink() and time.time() - last > UNUSED:
                shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def _ending_at_once() -> Generator[None]:
    """Let signals end the process at once: there is nothing to save, and Python may lose an exception inside the compiler."""

    def end(number: int, _: object) -> None:
        notes().show_cursor()
        # Not through the console, which may be printing.
        os.write(2, b"Interrupted: the next start compiles what is missing.\n")
        os._exit(128 + number)

    with answering(end):
        yield


@contextmanager
def compiling_the_rest() -> Generator[None]:
    """Compile everything that the first picture does not need, in a separate process, unless that has been done."""
    from flexlab.sim.compile_all import WHILE_OPEN, is_everything_compiled

    if is_everything_compiled():
        yield
        return
    nowhere = subprocess.DEVNULL
    program = [sys.executable, "-m", "flexlab.sim.compile_all", WHILE_OPEN]
    # A killed lab closes the pipe, which ends this process too.
    process = subprocess.Popen(program, stdin=subprocess.PIPE, stdout=nowhere, stderr=nowhere)
    try:
        yield
    finally:
        process.terminate()
        process.communicate()


def _wheel() -> AbstractContextManager[object]:
    """A spinner with the elapsed time on a terminal."""
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    if not notes().is_terminal:
        return nullcontext()
    columns = SpinnerColumn(), TextColumn("compiling"), TimeElapsedColumn()
    progress = Progress(*columns, console=notes(), transient=True)
    progress.add_task("compiling", total=None)
    return progress
