"""Keeps pyarrow from importing pandas, which flexlab's own processes do not need: half a second and 40 MB each."""

import sys
from typing import Any

import pyarrow as pa


class _NoPandas:
    """An import finder that hides pandas and leaves all other modules to the next finder."""

    def find_spec(self, name: str, path: Any, target: Any = None, /) -> None:
        if name == "pandas":
            raise ModuleNotFoundError("No module named 'pandas'", name=name)


def leave_pandas_out() -> None:
    """Hide pandas from pyarrow, which then treats a pandas series as a list; other imports of pandas still work.

    Only for processes of the command line and of the lab. pyarrow looks for pandas when it converts its first list.
    """
    if "pandas" in sys.modules:
        return
    finder = _NoPandas()
    sys.meta_path.insert(0, finder)
    try:
        pa.array([True])
    finally:
        sys.meta_path.remove(finder)
