"""Where numba keeps the machine code of functions in a person's text that ask for it (`@njit(cache=True)`)."""

import os
from typing import Any

from flexlab.assets import user_cache

DIGEST = "__digest_of_text__"
"""Name of a module's variable with a digest of the text that it belongs to."""

OWN_TEXTS = "own-texts"
"""Folder of that machine code, with a folder for each text."""


def file_machine_code_by_text() -> None:
    """Make numba keep it by a digest of the whole text.

    Numba goes by the file alone. A recorded law has none, and one with other data or another module beside it, or as it was when
    it was recorded, would run with machine code that holds other numbers.
    """
    from numba.core import caching  # Slow to load, and most texts do without.

    class ByText(caching._CacheLocator):
        """A place for the functions of texts, and for no others."""

        def __init__(self, function: Any):
            self._digest, code = function.__globals__[DIGEST], function.__code__
            self._name = f"{function.__module__}-{code.co_firstlineno}"

        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> "ByText | None":
            """None for other functions, or if the folder cannot be written: numba then looks for another place."""
            if DIGEST not in py_func.__globals__:
                return None
            found = cls(py_func)
            try:
                found.ensure_cache_path()
            except OSError:
                return None
            return found

        def get_cache_path(self) -> str:
            """The folder of the text."""
            base = os.environ.get("NUMBA_CACHE_DIR") or str(user_cache())
            return os.path.join(base, "flexlab", OWN_TEXTS, self._digest)

        def get_source_stamp(self) -> str:
            """The digest of the text."""
            return self._digest

        def get_disambiguator(self) -> str:
            """Module and line of the function."""
            return self._name

    known = caching.CompileResultCacheImpl._locator_classes
    if not any(one.__name__ == ByText.__name__ for one in known):
        known.insert(0, ByText)
