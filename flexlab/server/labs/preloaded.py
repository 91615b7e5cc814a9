"""Imported once by the process from which labs and jobs are forked (`job_processes`), so that they share its memory."""

import gc
import logging
import sys
from contextlib import suppress
from importlib import import_module

from flexlab.errors import FlexlabError
from flexlab.presets import load_preset
from flexlab.recording import leave_pandas_out
from flexlab.server.labs import worker
from flexlab.server.tasks import leave_interrupts_to_the_server
from flexlab.sim.world import World

READ_LATE = ("dateutil.parser", "imageio.v3", "PIL.Image", "pyarrow.compute", "rich.table")
"""Modules that a lab's libraries import only when they draw or record, if installed: a third of its memory and half a second of
its start."""
LAB = worker
"""The module for which this one is imported."""


def _try_out() -> None:
    """Run the engine once, so that its machine code is in memory. No thread is started, as none survives a fork."""
    try:
        World(load_preset("paper")).advance(2)
    except (FlexlabError, OSError):
        # A lab that fails in the same way will tell its visitor.
        logging.getLogger(__name__).warning("The engine could not be tried out ahead of the first lab.", exc_info=True)


leave_interrupts_to_the_server()
for name in READ_LATE:
    with suppress(ImportError):
        import_module(name)
if "PIL.Image" in sys.modules:
    sys.modules["PIL.Image"].init()
leave_pandas_out()
_try_out()
# Freeze the present objects: if a forked process's collector wrote to them, their memory would no longer be shared.
gc.collect()
gc.freeze()
