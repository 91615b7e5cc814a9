"""What numba does not promise and flexlab uses: inlined kernels that are compiled no further than their callers need.

Numba optimises every function on its own, makes machine code of it and wraps it for Python, before it inlines it. For
kernels that only kernels call, all that is thrown away: it was more than half of the time of the first start on a machine.
A contract test says so when a version of numba does this differently.
"""

from typing import Any

from numba import _dynfunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering

NOWHERE = 1
"""Address of a function that is never called; numba takes 0 for a failure."""


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
        """Lower the kernel and let other kernels know it."""
        state.library = BitcodeLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_cpython_wrapper = state.flags.no_compile = True
        done = super().run_pass(state)
        result = state["cr"]
        # Numba knows a compiled function by the built-in function that calls it. `Inlined` keeps Python away from this one.
        module, name = result.fndesc.lookup_module(), result.fndesc.qualname.split(".")[-1]
        key = _dynfunc.make_function(module, name, "inlined", NOWHERE, result.env, (state.library,))
        state["cr"] = result._replace(cfunc=key)
        state.targetctx.insert_user_function(key, result.fndesc, [state.library])
        return done


class InlinedCompiler(CompilerBase):
    """Numba's compiler with `BitcodeLowering` in the place of its lowering."""

    def define_pipelines(self) -> list[Any]:
        """The one pipeline."""
        pipeline = DefaultPassBuilder.define_nopython_pipeline(self.state)
        at = next(k for k, (each, _) in enumerate(pipeline.passes) if each is NativeLowering)
        pipeline.passes[at] = (BitcodeLowering, "inlined lowering")
        pipeline._finalized = False
        pipeline.finalize()
        return [pipeline]


class Inlined:
    """A kernel that numba compiles into its callers. Called from Python, it is the Python function that it is written as."""

    def __init__(self, dispatcher: Any):
        self._dispatcher, self._numba_type_ = dispatcher, dispatcher._numba_type_
        self.py_func = dispatcher.py_func
        self.__name__, self.__doc__ = self.py_func.__name__, self.py_func.__doc__
        self.__module__, self.__qualname__ = self.py_func.__module__, self.py_func.__qualname__

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)
