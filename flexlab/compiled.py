"""The decorator of every numerical kernel: compiled by numba, cached on disk, running without Python's global lock.

Numba notices a change in a cached function's own file, not in the functions it calls. So the cache folder's name holds a
digest of all kernel sources: any edit compiles afresh and no stale machine code can run.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

_PACKAGE = Path(__file__).parent
_KERNEL_ROOMS = ("physics", "control", "sim")


def _digest() -> str:
    digest = hashlib.sha256(numba.__version__.encode() + Path(__file__).read_bytes())
    for room in _KERNEL_ROOMS:
        for file in sorted((_PACKAGE / room).rglob("*.py")):
            digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Where machine code is kept: below NUMBA_CACHE_DIR or the user's cache folder, one folder per source version."""
    base = os.environ.get("NUMBA_CACHE_DIR")
    root = Path(base) if base else Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache"))
    return root / "flexlab" / f"kernels-{_DIGEST}"


_DIGEST = _digest()


def is_warm() -> bool:
    """Whether the engine's main kernel has been compiled for these sources before."""
    return any(cache_folder().rglob("advance*.nbi"))


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """A kernel that Python calls: cached machine code, no global lock, IEEE division; `.py_func` is the plain Python.

    Reference counting is off: a kernel that would allocate memory does not compile.
    """
    return _compile(function, cache=True)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """A kernel that only kernels call: always inlined, as handing over a whole system costs more than most of them."""
    return _compile(function, cache=True, forceinline=True)


def inlined_sums(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `inlined`, with sums in an order that suits vector units: the same machine still gives the same bits."""
    return _compile(function, cache=True, forceinline=True, fastmath={"reassoc", "contract"})


def _compile(function: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    previous = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(cache_folder())  # type: ignore[attr-defined]
    try:
        return numba.njit(nogil=True, error_model="numpy", _nrt=False, no_cfunc_wrapper=True, **options)(function)
    finally:
        numba.config.CACHE_DIR = previous  # type: ignore[attr-defined]
