"""Loading modules: what they make is there to stay, and a search for garbage among it is a tenth of a start."""

import gc
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def loading() -> Generator[None, None, None]:
    """While modules load, no garbage is looked for, and never again among what they have made."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
