"""Imported once by the process from which labs and jobs are forked (`job_processes`), so that they share its memory."""

import gc
import logging
import sys
from contextlib import suppress
from importlib import import_module

import pyarrow  # type: ignore[import-untyped]  # It ships no types.

from flexlab.errors import FlexlabError
from flexlab.presets import load_preset
from flexlab.server.labs import worker
from flexlab.server.tasks import leave_interrupts_to_the_server
from flexlab.sim.world import World

READ_LATE = ("dateutil.parser", "imageio.v3", "PIL.Image", "pyarrow.compute", "rich.table")
"""What a lab's libraries read only when they draw or record, if they are there: a third of its memory, half a second of its
start."""
LAB = worker
"""The module that this is read for."""


def _try_out() -> None:
    """Go through the engine once, so that its machine code is in memory; no thread is begun, as none survives a fork."""
    try:
        World(load_preset("paper")).advance(2)
    except (FlexlabError, OSError):
        # A lab that needs it will say so to its visitor.
        logging.getLogger(__name__).warning("The engine could not be tried out ahead of the first lab.", exc_info=True)


leave_interrupts_to_the_server()
for name in READ_LATE:
    with suppress(ImportError):
        import_module(name)
if "PIL.Image" in sys.modules:
    sys.modules["PIL.Image"].init()
# With its first list pyarrow reads pandas, where that is installed.
pyarrow.array([True])  # pyright: ignore[reportUnknownMemberType]
_try_out()
# What is there now stays: the collector of a forked process need not write into it, which would unshare it.
gc.collect()
gc.freeze()
