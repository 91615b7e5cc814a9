"""pyarrow, on which recordings stand, imports pandas where it is installed, at its first list: half a second for nothing."""

import sys
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]  # It ships no types.


class _NoPandas:
    """Finds no pandas, and leaves every other module to the finders after it."""

    def find_spec(self, name: str, path: Any, target: Any = None, /) -> None:
        """As of `importlib.abc.MetaPathFinder`."""
        if name == "pandas":
            raise ModuleNotFoundError("No module named 'pandas'", name=name)


def leave_pandas_out() -> None:
    """Let pyarrow look for pandas now, and not find it; what asks for pandas by name still gets it.

    For processes that are the command line's own: from then on, a pandas series is to pyarrow a list like any other.
    """
    if "pandas" in sys.modules:
        return
    finder = _NoPandas()
    sys.meta_path.insert(0, finder)
    try:
        pa.array([True])  # type: ignore[reportUnknownMemberType]  # As above.
    finally:
        sys.meta_path.remove(finder)
