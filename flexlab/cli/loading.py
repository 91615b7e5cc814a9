"""Loading modules without what a start can do without: a search for garbage among them, and modules that nobody asks."""

import gc
import sys
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import LazyLoader
from typing import Any

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
