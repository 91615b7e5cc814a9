"""The decorators of numerical kernels: compiled by numba, cached on disk, running without Python's global lock.

Numba notices a change in a cached function's own file, but not in the functions that it calls. The name of the cache folder
therefore contains a digest of all kernel sources: any edit compiles anew, and no stale machine code can run.
"""

import hashlib
import logging
import os
import sys
from collections.abc import Callable, Hashable
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numba
import numpy as np
from llvmlite import ir
from llvmlite.binding import get_host_cpu_name
from numba.core import config, event
from numba.extending import intrinsic

from flexlab.assets import code_cache

_settings: Any = config
"""Any, as numba fills in this module's names at run time."""
PLAIN_PYTHON = bool(_settings.DISABLE_JIT)
"""Whether compilation is off (NUMBA_DISABLE_JIT=1): every kernel is then its plain Python function."""
FIRST_KNOWN, FIRST_UNKNOWN = (0, 61), (0, 69)
"""Versions of numba that `flexlab.numba_internals` supports: from the first on, below the second."""
QUICK = FIRST_KNOWN <= numba.version_info.short < FIRST_UNKNOWN and not os.environ.get("FLEXLAB_PLAIN_NUMBA")
"""Whether numba's compiler is accelerated; if not, only the first start takes longer."""

if TYPE_CHECKING or QUICK:
    from flexlab.numba_internals import (
        CalledCompiler,
        DisjointCompiler,
        Inlined,
        InlinedCompiler,
        QuickCache,
        QuickCompiler,
        fingerprint,
    )

_PACKAGE = Path(__file__).parent
_KERNEL_ROOMS = ("numerics", "physics", "control", "sim")
_COMPILING = ("compiled.py", "numba_internals.py", "registry.py")
"""Files that determine how kernels are compiled, and their names in the cache."""


def _digest() -> str:
    digest = hashlib.sha256(f"{numba.__version__} {QUICK}".encode())
    for name in _COMPILING:
        digest.update((_PACKAGE / name).read_bytes())
    for room in _KERNEL_ROOMS:
        for file in sorted((_PACKAGE / room).rglob("*.py")):
            digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()[:16]


def engine() -> str:
    """A name for the kernel sources and their compiler; equal names mean equal results."""
    return f"kernels-{_DIGEST}"


def cache_folder() -> Path:
    """The folder of machine code, one per version of the sources, of Python and of the processor.

    It is below NUMBA_CACHE_DIR or the user's cache folder, which several machines may share.
    """
    made_for = f"{_DIGEST} {sys.implementation.cache_tag} {_settings.CPU_NAME or _PROCESSOR}"
    return code_cache() / f"kernels-{hashlib.sha256(made_for.encode()).hexdigest()[:16]}"


_DIGEST = _digest()
_PROCESSOR = get_host_cpu_name()


def is_warm() -> bool:
    """Whether the engine's main kernel has been compiled for these sources before."""
    return any(cache_folder().rglob("advance*.nbc"))


A_MOMENT = 1.5
"""Compile time after which the user is told, s."""
COMPILING = (
    "flexlab is compiling the equations of motion that it needs here for the first time, once for this version on this machine: "
    "usually less than half a minute."
)


class Compilation(event.Listener):
    """Announces compilation once: when kernels have taken `A_MOMENT` and another one begins.

    Numba holds its lock meanwhile. By default a warning is logged, which is visible even without logging set up.
    """

    def __init__(self) -> None:
        self.tell: Callable[[], None] = lambda: logging.getLogger("flexlab").warning(COMPILING)
        self.told = False
        self._depth, self._began, self._spent = 0, 0.0, 0.0

    def on_start(self, event: Any) -> None:
        """Note that a kernel begins to compile; kernels that it calls compile within it."""
        if not _is_own(event):
            return
        now = perf_counter()
        if self._depth == 0:
            self._began = now
        self._depth += 1
        if not self.told and self._spent + now - self._began > A_MOMENT:
            self.told = True
            self.tell()

    def on_end(self, event: Any) -> None:
        """Note that a kernel is compiled, or has failed to compile."""
        if not _is_own(event):
            return
        self._depth -= 1
        if self._depth == 0:
            self._spent += perf_counter() - self._began


def _is_own(event: Any) -> bool:
    return (event.data["dispatcher"].py_func.__module__ or "").startswith("flexlab.")


COMPILATION = Compilation()
event.register("numba:compile", COMPILATION)


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """A kernel that Python calls: cached machine code, no global lock, IEEE division; `.py_func` is the plain Python.

    Reference counting is off, so a kernel that allocates memory does not compile. Other kernels may call it; code that they
    seldom need is then compiled once instead of into each of them.
    """
    # Else the kernel would inherit `forceinline` from whichever kernel happens to call it first.
    return _compile(function, cache=True, forceinline=False, **({"pipeline_class": CalledCompiler} if QUICK else {}))


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """A kernel that only kernels call: always inlined, because passing a whole system costs more than most kernels."""
    return function if PLAIN_PYTHON else _inline(function, InlinedCompiler if QUICK else None)


def disjoint(function: Callable[..., Any]) -> Callable[..., Any]:
    """As `inlined`, for kernels whose written arrays share no memory with their other arrays.

    Loops over them then use vector units without a check for overlap.
    """
    return function if PLAIN_PYTHON else _inline(function, DisjointCompiler if QUICK else None)


def _inline(function: Callable[..., Any], compiler: Any) -> Callable[..., Any]:
    if compiler is None:
        return _compile(function, forceinline=True)
    return Inlined(_compile(function, forceinline=True, pipeline_class=compiler))


def pluggable(function: Callable[..., Any]) -> Callable[..., Any]:
    """A kernel chosen at run time, such as a law's or a path's: `call_kernel` calls it by its `kernel_address`.

    Its first argument is the record of its parameters. The engine's loop is compiled once for all of them.
    """
    return _compile(function, cache=True, no_cfunc_wrapper=False)


def _compile(
    function: Callable[..., Any], cache: bool = False, no_cfunc_wrapper: bool = True, **options: Any
) -> Callable[..., Any]:
    # Not for users' own kernels: they may call functions that numba must load first.
    quick = QUICK and cache and not PLAIN_PYTHON and function.__module__.startswith("flexlab.")
    options |= {"cache": cache and not quick, "no_cfunc_wrapper": no_cfunc_wrapper}
    if QUICK:
        options.setdefault("pipeline_class", QuickCompiler)
    previous = _settings.CACHE_DIR
    _settings.CACHE_DIR = str(cache_folder())
    try:
        kernel = numba.njit(nogil=True, error_model="numpy", _nrt=False, **options)(function)
        if quick:
            kernel._cache = QuickCache(function)
        return kernel
    finally:
        _settings.CACHE_DIR = previous


_entry_points: dict[tuple[int, Any], Callable[..., Any]] = {}


def entry_point(kernel: Any, *arguments: Any) -> Callable[..., Any]:
    """The machine code of a `compiled` kernel for arguments of these types, called without a check of types.

    A system has a hundred arrays, so checking types at each call takes longer than a step of the engine. Never pass arguments
    of other types: machine code does not notice.
    """
    if PLAIN_PYTHON:
        return kernel
    key = id(kernel), fingerprint(arguments) if QUICK else tuple(numba.typeof(value) for value in arguments)
    if key not in _entry_points:
        _entry_points[key] = kernel.compile(tuple(numba.typeof(value) for value in arguments))
    return _entry_points[key]


VECTOR, MATRIX = numba.float64[::1], numba.float64[:, ::1]
"""Types of kernel arguments: contiguous arrays."""

_plain: dict[int, tuple[Callable[..., Any], np.dtype]] = {}


def kernel_address(kernel: Any, parameters: np.dtype, *arguments: Any, returns: Any = numba.void) -> int:
    """The address of a `pluggable` kernel, compiled (or loaded) for a parameter record and argument types."""
    if PLAIN_PYTHON:
        _plain[id(kernel)] = kernel, parameters
        return id(kernel)
    result = kernel.get_compile_result(returns(numba.from_dtype(parameters), *arguments))
    return result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name)


_addresses: dict[tuple[int, Hashable], int] = {}


def whole_address(kernel: Any, arguments: Callable[[], tuple[Any, ...]], variant: Hashable = None) -> int:
    """The address of a kernel for `call_whole_kernel`, compiled (or loaded) for the types of these arguments.

    `arguments` is called once: all worlds of the same `variant` have arguments of the same types.
    """
    if PLAIN_PYTHON:
        _plain[id(kernel)] = kernel, np.dtype([])
        return id(kernel)
    key = id(kernel), variant
    if key not in _addresses:
        result = kernel.get_compile_result(numba.int64(*(numba.typeof(value) for value in arguments())))
        _addresses[key] = result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name)
    return _addresses[key]


def has_address(kernel: Any, variant: Hashable = None) -> bool:
    """Whether `whole_address` has compiled or loaded a kernel for worlds of a variant."""
    return PLAIN_PYTHON or (id(kernel), variant) in _addresses


def _call(context: Any, builder: Any, signature: Any, values: Any, result: Any) -> Any:
    """Emit a call to an address, with a pointer to the parameters and the members of a tuple."""
    address, parameters, packed = values
    data = context.make_array(signature.args[1])(context, builder, parameters).data
    given = [builder.bitcast(data, ir.IntType(8).as_pointer())]
    given += [builder.extract_value(packed, k) for k in range(len(signature.args[2]))]
    kind = ir.FunctionType(result, [value.type for value in given])
    return builder.call(builder.inttoptr(address, kind.as_pointer()), given)


class Attributes(SimpleNamespace):
    """A record's fields as kernels read them: `record.name`, or `record["from"]` for a name reserved by Python."""

    def __getitem__(self, name: str) -> Any:
        """The field of that name."""
        return getattr(self, name)


def attributes(flat: np.ndarray, record: np.dtype) -> Attributes:
    """The fields of a record stored flat in memory; methods of a `np.recarray` would hide those called `mean`, `size` or `T`."""
    values = flat.view(record)[0]
    return Attributes(**{name: values[name] for name in record.names or ()})


def _call_plainly(address, parameters, arguments):
    """Call the kernel at `address` as its plain Python function."""
    function, record = _plain[address]
    return function(attributes(parameters, record), *arguments)


@intrinsic
def call_kernel(typing, address, parameters, arguments):
    """Call the kernel at `address` with its parameters (flat, (k,)) and a tuple of further arguments."""

    def code(context, builder, signature, values):
        _call(context, builder, signature, values, ir.VoidType())
        return context.get_dummy_value()

    return numba.void(numba.int64, parameters, arguments), code


@intrinsic
def call_number_kernel(typing, address, parameters, arguments):
    """As `call_kernel`, for a kernel that returns a number."""

    def code(context, builder, signature, values):
        return _call(context, builder, signature, values, ir.DoubleType())

    return numba.float64(numba.int64, parameters, arguments), code


def _call_whole_plainly(address, arguments):
    """Call the kernel at `address` as its plain Python function."""
    return _plain[address][0](*arguments)


@intrinsic
def call_whole_kernel(typing, address, arguments):
    """Call a kernel that returns a whole number at its `whole_address` with a tuple of arguments."""

    def code(context, builder, signature, values):
        given = [builder.extract_value(values[1], k) for k in range(len(signature.args[1]))]
        kind = ir.FunctionType(ir.IntType(64), [value.type for value in given])
        return builder.call(builder.inttoptr(values[0], kind.as_pointer()), given)

    return numba.int64(numba.int64, arguments), code


if PLAIN_PYTHON:
    globals().update(call_whole_kernel=_call_whole_plainly)
    globals().update(call_kernel=_call_plainly, call_number_kernel=_call_plainly)
