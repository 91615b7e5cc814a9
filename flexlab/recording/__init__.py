"""Recordings: every run as a rerun file that can be watched live, found again, and read back bit for bit.

Only this package imports rerun. Rerun's log lines are off unless RUST_LOG is set: this package reports problems with files
and ports in sentences of its own.
"""

import os
import sys
from typing import Any

os.environ.setdefault("RUST_LOG", "off")


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
    import pyarrow as pa

    finder = _NoPandas()
    sys.meta_path.insert(0, finder)
    try:
        pa.array([True])
    finally:
        sys.meta_path.remove(finder)
