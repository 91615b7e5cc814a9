"""Uses of numba's internals: a compiler that does no work twice, and a cache that loads only what a run needs.

Numba optimises every function on its own, turns it into machine code and wraps it for Python before it inlines it. For kernels
that only kernels call, this work is discarded; it was more than half of the first start on a machine. A third of the rest went
into typing the same sum of two numbers again and again, and into garbage collection. Taking a system apart into its seven hundred
numbers and pointers, and putting it together again, at each call between kernels, made two thirds of the code that LLVM read.
Contract tests fail if a version of numba works differently.
"""

import gc
import hashlib
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from llvmlite.binding import parse_bitcode
from numba import _dispatcher, _dynfunc
from numba.core import config
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.datamodel.models import DataModel, TupleModel
from numba.core.datamodel.registry import default_manager
from numba.core.lowering import Lower
from numba.core.targetconfig import ConfigStack
from numba.core.typed_passes import NativeLowering
from numba.core.types import BaseTuple, NamedTuple
from numba.core.types.functions import BaseFunction


class LoadedLibrary(JITCodeLibrary):
    """Machine code from disk. Its bitcode, which other kernels link, is parsed when one of them does."""

    _bitcode: bytes

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> "LoadedLibrary":
        name, _, (machine_code, bitcode) = state
        library = cls(codegen, name)
        library._bitcode = bitcode
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        library._finalize_final_module()
        return library

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None:
            self._shared_module = parse_bitcode(self._bitcode)
        return self._shared_module


class _BySource(_CacheLocator):
    """Files a kernel under its module's name and text.

    Numba uses the path of the source, so each checkout and each environment would compile the same version again.
    """

    def __init__(self, function: Any, file: str):
        self._folder = os.path.join(config.CACHE_DIR, function.__module__)  # type: ignore[attr-defined]  # Set at import.
        self._line = function.__code__.co_firstlineno
        with open(file, "rb") as source:
            self._stamp = hashlib.sha256(source.read()).hexdigest()

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> "_BySource | None":
        """None if the source cannot be read or the folder cannot be written: numba then looks for another place."""
        try:
            found = cls(py_func, py_file)
            found.ensure_cache_path()
        except OSError:
            return None
        return found

    def get_cache_path(self) -> str:
        """The folder of the kernel's module."""
        return self._folder

    def get_source_stamp(self) -> str:
        """A digest of the module's text."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """The kernel's line."""
        return str(self._line)


class _KeptResults(CompileResultCacheImpl):
    """A compiled kernel as numba stores it, plus the names in its machine code, so that they need not be searched."""

    _locator_classes = (_BySource, *CompileResultCacheImpl._locator_classes)

    def reduce(self, cres: Any) -> Any:
        """As plain data, without environments that have no constants: the wrapper reads only the kernel's own."""
        module = cres.library._get_module_for_linking()
        names = {
            each.name
            for part in (module.functions, module.global_variables)
            for each in part
            if not each.is_declaration
        }
        *result, environments = super().reduce(cres)
        read = tuple(each for each in environments if each.consts or each is cres.environment)
        return names, (*result, read)

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """The kernel, loaded; numba's lock is held."""
        names, result = payload
        codegen = target_context.codegen()
        codegen._engine._defined_symbols |= names
        usual, codegen._library_class = codegen._library_class, LoadedLibrary
        try:
            return super().rebuild(target_context, result)
        finally:
            codegen._library_class = usual


class _FileEach(IndexDataCacheFile):
    """One file for each kernel and its argument types.

    Numba numbers its files and keeps an index of them. Two processes that compile at once could give the same number to
    two kernels, and a third process would run the wrong machine code.
    """

    def save(self, key: Any, data: Any) -> None:
        """Store a kernel; the last writer wins, with the same machine code."""
        self._save_data(self._name(key), data)

    def load(self, key: Any) -> Any:
        """The kernel, or None."""
        try:
            return self._load_data(self._name(key))
        except OSError:
            return None

    def _name(self, key: Any) -> str:
        digest = hashlib.sha256(f"{self._version} {self._source_stamp} {key}".encode()).hexdigest()
        return self._data_name_pattern.format(number=int(digest[:16], 16))


class QuickCache(FunctionCache):
    """Machine code on disk, loaded without numba's translations of numpy, which only compiling needs.

    This saves half a second of each start. Kernels without reference counting (`_nrt=False`) do not need its runtime either.
    """

    _impl_class = _KeptResults

    def __init__(self, function: Any):
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = _FileEach(locator.get_cache_path(), self._impl.filename_base, locator.get_source_stamp())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """As numba's, without the refresh of `target_context`, which the compiler does itself if needed."""
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


def fingerprint(arguments: tuple[Any, ...]) -> bytes:
    """Numba's fingerprint of the types of arguments, in a hundredth of the time that naming them takes."""
    return _dispatcher.compute_fingerprint(arguments)


NOWHERE = 1
"""Address of a function that is never called; 0 would mean a failure to numba."""


class BitcodeLibrary(JITCodeLibrary):
    """Code that is only linked into other code: neither optimised nor turned into machine code by itself."""

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True


@register_pass(mutates_CFG=True, analysis_only=False)
class BitcodeLowering(NativeLowering):
    """Lowers a kernel into a `BitcodeLibrary`, without the wrapper that Python would call."""

    _name = "flexlab_bitcode_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower the kernel and register it for other kernels."""
        state.library = BitcodeLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_cpython_wrapper = state.flags.no_compile = True
        done = super().run_pass(state)
        result = state["cr"]
        # Numba identifies a compiled function by the built-in function that calls it. `Inlined` keeps Python from calling this
        # one.
        module, name = result.fndesc.lookup_module(), result.fndesc.qualname.split(".")[-1]
        key = _dynfunc.make_function(module, name, "inlined", NOWHERE, result.env, (state.library,))
        state["cr"] = result._replace(cfunc=key)
        state.targetctx.insert_user_function(key, result.fndesc, [state.library])
        return done


class _OutOfLine(Lower):
    """Lowers a function that is never inlined."""

    def setup_function(self, fndesc: Any) -> None:
        """As numba's, with an attribute that tells LLVM."""
        super().setup_function(fndesc)
        self.function.attributes.add("noinline")


@register_pass(mutates_CFG=True, analysis_only=False)
class CalledLowering(NativeLowering):
    """Lowers a kernel that Python calls out of line, so that kernels that seldom call it do not contain it."""

    _name = "flexlab_called_lowering"

    @property
    def lowering_class(self) -> type[Lower]:
        """The class that lowers."""
        return _OutOfLine


class _Typing:
    """Numba's results for calls of built-in functions, by function and argument types."""

    def __init__(self, find: Callable[..., Any]):
        self._find, self._known, self._flags = find, {}, {}

    def __call__(self, function: Any, context: Any, arguments: Any, keywords: Any) -> Any:
        """As `BaseFunction.get_call_type`, which lowering calls again for each sum of two numbers."""
        flags = ConfigStack.top_or_none()
        _, summary = self._flags.setdefault(id(flags), (flags, flags.summary() if flags else ""))
        if keywords:
            return self._find(function, context, arguments, keywords)
        key = context, function, tuple(arguments), summary
        if key not in self._known:
            self._known[key] = self._find(function, context, arguments, keywords)
        return self._known[key]


class _Quick:
    """Whether numba's compiler is accelerated; its own lock guards it."""

    on = False


@contextmanager
def quick_compiler() -> Iterator[None]:
    """Accelerate numba while kernels are compiled: nothing is typed twice, no garbage is collected."""
    if _Quick.on:
        yield
        return
    find, collects = BaseFunction.get_call_type, gc.isenabled()
    typing = _Typing(find)
    _Quick.on = True
    gc.disable()
    BaseFunction.get_call_type = lambda self, context, args, kws: typing(self, context, args, kws)
    try:
        yield
    finally:
        BaseFunction.get_call_type = find
        _Quick.on = False
        if collects:
            gc.enable()


class QuickCompiler(CompilerBase):
    """Numba's compiler, accelerated."""

    lowering = NativeLowering

    def _compile_core(self) -> Any:
        with quick_compiler():
            return super()._compile_core()

    def define_pipelines(self) -> list[Any]:
        """The one pipeline."""
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        at = next(k for k, (each, _) in enumerate(pipeline.passes) if each is NativeLowering)
        pipeline.passes[at] = (self.lowering, "lowering")
        pipeline._finalized = False
        pipeline.finalize()
        return [pipeline]


class CalledCompiler(QuickCompiler):
    """The same with `CalledLowering` in the place of numba's lowering."""

    lowering = CalledLowering


class InlinedCompiler(QuickCompiler):
    """The same with `BitcodeLowering` in the place of numba's lowering."""

    lowering = BitcodeLowering


class DisjointCompiler(InlinedCompiler):
    """The same for kernels whose arrays share no memory with one another, of which LLVM is told."""

    def define_pipelines(self) -> list[Any]:
        """The one pipeline."""
        self.state.flags.noalias = True
        return super().define_pipelines()


class _WholeTuple(TupleModel):
    """A named tuple that is one argument of a function; numba makes one of each number and pointer in it."""

    def get_argument_type(self) -> Any:
        """That of the value."""
        return self.get_value_type()

    def as_argument(self, builder: Any, value: Any) -> Any:
        """The value itself."""
        return value

    from_argument = as_argument


def _tuple_model(manager: Any, kind: NamedTuple) -> DataModel:
    """How kernels pass a named tuple: whole if it is flexlab's and holds others.

    Only kernels of this process pass those. Small ones gain nothing, and whole ones made steps up to a tenth slower.
    """
    is_own = kind.instance_class.__module__.startswith("flexlab.")
    return (_WholeTuple if is_own and any(isinstance(part, BaseTuple) for part in kind) else TupleModel)(manager, kind)


default_manager.register(NamedTuple, _tuple_model)


class Inlined:
    """A kernel that numba compiles into its callers. Called from Python, it is its plain Python function."""

    def __init__(self, dispatcher: Any):
        self._dispatcher, self._numba_type_ = dispatcher, dispatcher._numba_type_
        self.py_func = dispatcher.py_func
        self.__name__, self.__doc__ = self.py_func.__name__, self.py_func.__doc__
        self.__module__, self.__qualname__ = self.py_func.__module__, self.py_func.__qualname__

    def __call__(self, *arguments: Any) -> Any:
        """Run the Python function as machine code would: invalid operations give NaN, not a warning."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return self.py_func(*arguments)
