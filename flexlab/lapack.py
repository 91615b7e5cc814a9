"""LAPACK and BLAS during a run: decompositions without Python's global lock, and small matrices on one thread.

scipy's wrappers keep the lock while they compute, for a tenth of a second on a fine mesh. Its LAPACK is also available as plain C
functions, and ctypes releases the lock while one runs. numpy releases the lock itself, so its decompositions need none of
this. Analysis and drawing during a run use small matrices, for which idle BLAS threads would spin on busy cores.
"""

import ctypes
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from scipy.linalg import cython_lapack
from threadpoolctl import OpenBLASController, ThreadpoolController

_lock = threading.Lock()
_users = 0
_limit: Any = None


@cache
def _libraries() -> ThreadpoolController:
    """The BLAS libraries of this process, found once (1 ms), after numpy and scipy have loaded theirs."""
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Limit BLAS to one thread until the last concurrent user has left."""
    global _users, _limit
    with _lock:
        if _users == 0:
            OpenBLASController.clear_controlling_thread(force=True)
            _limit = _libraries().limit(limits=1, user_api="blas")
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                # threadpoolctl ignores limits from any but the first thread to set one; `_lock` keeps the order here.
                OpenBLASController.clear_controlling_thread(force=True)
                _limit.restore_original_limits()


@cache
def _routine(name: str, count: int) -> Callable[..., None]:
    """A LAPACK routine with `count` arguments, all pointers."""
    capsule: Any = cython_lapack.__pyx_capi__[name]
    api = ctypes.pythonapi
    name_of = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(("PyCapsule_GetName", api))
    pointer_of = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(("PyCapsule_GetPointer", api))
    return ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * count)(pointer_of(capsule, name_of(capsule)))


def _call(name: str, *arguments: bytes | int | np.ndarray | None) -> None:
    """Call a routine, with letters and numbers by reference. Raises `LinAlgError` if it fails."""
    info = ctypes.c_int()
    held = [
        ctypes.c_char(one) if isinstance(one, bytes) else ctypes.c_int(one) if isinstance(one, int) else one
        for one in arguments
    ]
    pointers = [
        one if one is None else one.ctypes.data if isinstance(one, np.ndarray) else ctypes.addressof(one)
        for one in held
    ]
    _routine(name, len(held) + 1)(*pointers, ctypes.addressof(info))
    if info.value != 0:
        raise np.linalg.LinAlgError(f"LAPACK's {name} found no result ({info.value})")


def _with_workspace(name: str, dtype: type, before: tuple, after: tuple) -> None:
    """Call a routine with a workspace of the size that it asks for, between its other arguments."""
    asked = np.empty(1, dtype)
    _call(name, *before, asked, -1, *after)
    work = np.empty(max(1, int(asked[0].real)), dtype)
    _call(name, *before, work, len(work), *after)


def complex_schur(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Upper triangular T and unitary Z with A = Z T Zᴴ, both (n, n) and complex, as `scipy.linalg.schur`."""
    n = len(_square(A))
    T, Z = np.array(A, dtype=complex, order="F"), np.empty((n, n), complex, order="F")
    values, real_work = np.empty(n, complex), np.empty(n)
    _with_workspace("zgees", complex, (b"V", b"N", None, n, T, n, 0, values, Z, n), (real_work, None))
    return T, Z


def eigenvectors(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eigenvalues (n,) of a real matrix (n, n), and its left and right eigenvectors as columns, as `scipy.linalg.eig`."""
    n = len(_square(A))
    scratch, real, imaginary = np.array(A, dtype=float, order="F"), np.empty(n), np.empty(n)
    left, right = np.empty((n, n), order="F"), np.empty((n, n), order="F")
    _with_workspace("dgeev", float, (b"V", b"V", n, scratch, n, real, imaginary, left, n, right, n), ())
    return real + 1j * imaginary, _paired(left, imaginary), _paired(right, imaginary)


def _square(A: np.ndarray) -> np.ndarray:
    """The matrix; raises ValueError if it is empty, not square or not finite, as LAPACK would then write out of bounds."""
    if A.ndim != 2 or A.shape[0] != A.shape[1] or A.shape[0] == 0 or not np.isfinite(A).all():
        raise ValueError(f"a square matrix of finite numbers is needed, not one of shape {A.shape}")
    return A


def _paired(vectors: np.ndarray, imaginary: np.ndarray) -> np.ndarray:
    """Complex eigenvectors as columns: LAPACK returns the real and imaginary parts of a conjugate pair in two columns."""
    found = vectors.astype(complex)
    first = np.flatnonzero(imaginary > 0)
    found[:, first] += 1j * vectors[:, first + 1]
    found[:, first + 1] = found[:, first].conj()
    return found
