"""Object files of compiled kernels for linkers, for any processor of this machine's kind.

Numba's optimised LLVM module of a kernel is turned into machine code for a processor without extensions, without Python's
wrappers. As no kernel contracts or reorders sums, it computes the same bits.
"""

import hashlib
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from llvmlite import ir
from numba import types

from flexlab.compiled import cache_folder
from flexlab.errors import StudyError

LIBRARY_FUNCTIONS = {"sqrt", "memset", "memcpy", "memmove"}
"""Functions that kernels may call: those of every C library whose result the standard fixes."""


def target_machine() -> Any:
    """Makes position-independent code for every processor of this machine's kind."""
    triple = llvm.get_process_triple()
    cpu = "x86-64" if triple.startswith("x86_64") else "generic"
    return llvm.Target.from_triple(triple).create_target_machine(cpu=cpu, opt=2, reloc="pic", codemodel="default")


def result_at(kernel: Any, address: int) -> Any:
    """Numba's compile result of the overload of a kernel at this address."""
    for result in kernel.overloads.values():
        if result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name) == address:
            return result
    raise StudyError(f"The machine code of {kernel.__name__} is not there: it was not compiled by this process.")


def write_object(result: Any, name: str, file: Path, by_words: bool = False) -> None:
    """Write the object file of a compiled kernel, which shows one function, `name`, and no more.

    It takes what `call_kernel` gives, or with `by_words` is `int32_t name(const int64_t *words, int64_t *returned)`: each word
    holds one of the plain arguments into which numba takes arrays and tuples apart. Raises `StudyError` for a kernel that calls
    more than mathematics.
    """
    bitcode, caller = result.library._get_module_for_linking().as_bitcode(), _caller(result, name, by_words)
    kept = cache_folder() / f"{hashlib.sha256(bitcode + caller.encode()).hexdigest()[:24]}.o"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        part = kept.with_name(f"{kept.name}.{file.parent.name}")
        part.write_bytes(_emit(bitcode, caller, result.fndesc.llvm_func_name, name))
        part.replace(kept)
    file.write_bytes(kept.read_bytes())


def _emit(bitcode: bytes, caller: str, kernel: str, name: str) -> bytes:
    module, machine = llvm.parse_bitcode(bitcode), target_machine()
    module.get_function(kernel).linkage = "external"
    module.link_in(llvm.parse_assembly(caller))
    for each in (*module.functions, *module.global_variables):
        if not each.is_declaration:
            each.linkage = "external" if each.name == name else "internal"
    module.get_function(name).visibility = "hidden"
    # What is left of Python: wrappers, their constants and what they call.
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(0)))
    foreign = {each.name for each in module.functions if each.is_declaration and not each.name.startswith("llvm.")}
    if not foreign <= LIBRARY_FUNCTIONS:
        raise StudyError(
            f"{name} calls {', '.join(sorted(foreign - LIBRARY_FUNCTIONS))}: only kernels of mathematics alone can be exported "
            "as machine code."
        )
    return machine.emit_object(module)


def _caller(result: Any, name: str, by_words: bool) -> str:
    """LLVM code of the function that calls a kernel, which raises nothing."""
    context, about = result.target_context, result.fndesc
    module, word = ir.Module(name), ir.IntType(64)
    module.triple, module.data_layout = llvm.get_process_triple(), str(target_machine().target_data)
    kind = context.call_conv.get_function_type(about.restype, about.argtypes)
    kernel = ir.Function(module, kind, about.llvm_func_name)
    if not by_words:
        values = [context.get_value_type(each) for each in about.argtypes]
        returned = context.get_value_type(about.restype)
        void = returned if about.restype != types.void else ir.VoidType()
        caller = ir.Function(module, ir.FunctionType(void, values), name)
        builder = ir.IRBuilder(caller.append_basic_block())
        _, answer = context.call_conv.call_function(builder, kernel, about.restype, about.argtypes, caller.args)
        builder.ret_void() if about.restype == types.void else builder.ret(answer)
        return str(module)
    pointer = word.as_pointer()
    caller = ir.Function(module, ir.FunctionType(ir.IntType(32), [pointer, pointer]), name)
    builder = ir.IRBuilder(caller.append_basic_block())
    words, answer = caller.args
    given = [builder.bitcast(answer, kind.args[0]), builder.alloca(kind.args[1].pointee)]
    for number, each in enumerate(kind.args[2:]):
        place = builder.gep(words, [ir.Constant(word, number)])
        given.append(builder.load(builder.bitcast(place, each.as_pointer())))
    builder.ret(builder.call(kernel, given))
    return str(module)


def data_object(data: bytes, name: str) -> bytes:
    """An object file with constant bytes under a name, aligned for vectors."""
    module = ir.Module(name)
    module.triple = llvm.get_process_triple()
    kind = ir.ArrayType(ir.IntType(8), len(data))
    constant = ir.GlobalVariable(module, kind, name)
    constant.initializer, constant.global_constant, constant.align = ir.Constant(kind, bytearray(data)), True, 64
    return target_machine().emit_object(llvm.parse_assembly(str(module)))
