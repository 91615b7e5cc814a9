"""pyarrow, on which recordings stand, imports pandas where it is installed, at its first list: half a second for nothing."""

import sys
from typing import Any

import pyarrow as pa  # type: ignore[import-untyped]


class _NoPandas:
    """Finds no pandas, and leaves every other module to the finders after it."""

    @staticmethod
    def find_spec(name: str, *_: Any) -> None:
        """As of `importlib.abc.MetaPathFinder`."""
        if name == "pandas":
            raise ModuleNotFoundError("No module named 'pandas'", name=name)


def leave_pandas_out() -> None:
    """Let pyarrow look for pandas now, and not find it; what asks for pandas by name still gets it.

    For processes that are the command line's own: from then on, a pandas series is to pyarrow a list like any other.
    """
    if "pandas" in sys.modules:
        return
    sys.meta_path.insert(0, _NoPandas)  # type: ignore[arg-type]
    try:
        pa.array([True])  # type: ignore[reportUnknownMemberType]
    finally:
        sys.meta_path.remove(_NoPandas)  # type: ignore[arg-type]
