"""Object files of compiled kernels, for any processor of this machine's kind, and the memory for their arguments.

Numba's optimised LLVM module of a kernel becomes machine code for a processor without extensions, without Python's wrappers.
It computes the same bits, because no kernel contracts or reorders sums.

A kernel's arguments are words: numbers, or places in two blocks of bytes. One block is constant and shared by all instances.
Of the other, each instance has its own copy: first its whole state, which changes with time, then the kernels' scratch arrays.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from llvmlite import ir
from numba import types

from flexlab.compiled import cache_folder
from flexlab.errors import StudyError
from flexlab.files import replacing
from flexlab.physics.plant import Workspace
from flexlab.sim.assembly import Assembly
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.step_size import build_scheme
from flexlab.sim.stepping import next_split_tick, steps_in

LIBRARY_FUNCTIONS = {"sqrt", "memset", "memcpy", "memmove"}
"""Functions that kernels may call: every C library has them, and the standard fixes their results."""


def target_machine() -> Any:
    """A target for position-independent code that runs on every processor of this machine's kind."""
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
    """Write the object file of a compiled kernel, whose only visible function is `name`.

    The function takes the arguments of `call_kernel`, or with `by_words` is
    `int32_t name(const int64_t *words, int64_t *returned)`: each word holds one of the numbers and pointers of which arrays and
    tuples consist. Raises `StudyError` for a kernel that calls more than mathematics.
    """
    bitcode, caller = result.library._get_module_for_linking().as_bitcode(), _caller(result, name, by_words)
    kept = cache_folder() / f"{hashlib.sha256(bitcode + caller.encode()).hexdigest()[:24]}.o"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        with replacing(kept) as draft:
            draft.write_bytes(_emit(bitcode, caller, result.fndesc.llvm_func_name, name))
    file.write_bytes(kept.read_bytes())


def _emit(bitcode: bytes, caller: str, kernel: str, name: str) -> bytes:
    module, machine = llvm.parse_bitcode(bitcode), target_machine()
    module.get_function(kernel).linkage = "external"
    module.link_in(llvm.parse_assembly(caller))
    for each in (*module.functions, *module.global_variables):
        if not each.is_declaration:
            each.linkage = "external" if each.name == name else "internal"
    module.get_function(name).visibility = "hidden"
    # Remove what is left of Python: wrappers, their constants and what they call.
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
    """LLVM code of the function that calls a kernel; the kernel raises nothing."""
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
    numbers = count()

    def read(kind: Any) -> Any:
        """The next argument, or part of one."""
        if not isinstance(kind, ir.LiteralStructType | ir.ArrayType):
            place = builder.gep(words, [ir.Constant(word, next(numbers))])
            return builder.load(builder.bitcast(place, kind.as_pointer()))
        whole = ir.Constant(kind, ir.Undefined)
        for k in range(len(kind)):
            whole = builder.insert_value(whole, read(kind.gep(ir.Constant(ir.IntType(32), k))), k)
        return whole

    returned = [builder.bitcast(answer, kind.args[0]), builder.alloca(kind.args[1].pointee)]
    builder.ret(builder.call(kernel, returned + [read(each) for each in kind.args[2:]]))
    return str(module)


def data_object(data: bytes, name: str) -> bytes:
    """An object file with constant bytes under a name, aligned for vectors."""
    module = ir.Module(name)
    module.triple = llvm.get_process_triple()
    kind = ir.ArrayType(ir.IntType(8), len(data))
    constant = ir.GlobalVariable(module, kind, name)
    constant.initializer, constant.global_constant, constant.align = ir.Constant(kind, bytearray(data)), True, 64
    return target_machine().emit_object(llvm.parse_assembly(str(module)))


ALIGNMENT = 64
"""Alignment of arrays, bytes: a cache line."""
HEAD, CLOCK = 4 * 8, 3 * 8
"""Bytes of an instance's state before its arrays: tick, level of the step, phase, time (`State` in unit.h);
and the place of the time among them."""
NUMBER, OWN, SHARED = 0, 1, 2
"""Kinds of words: a number's bits, or the place of an array in the instance's memory or in the constants."""


def words_of(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """The named words of an argument in numba's order: numbers, and arrays for pointers."""
    if isinstance(value, np.ndarray):
        yield f"{name}.meminfo", 0
        yield f"{name}.parent", 0
        yield f"{name}.size", value.size
        yield f"{name}.itemsize", value.itemsize
        yield f"{name}.data", value
        for axis in range(value.ndim):
            yield f"{name}.shape{axis}", value.shape[axis]
        for axis in range(value.ndim):
            yield f"{name}.stride{axis}", value.strides[axis]
    elif isinstance(value, tuple):
        for part, each in zip(getattr(value, "_fields", range(len(value))), value, strict=True):
            yield from words_of(each, f"{name}.{part}")
    else:
        yield name, 0 if value is None else value


def bits(number: float) -> int:
    """A number as 64 bits for machine code."""
    kind = np.float64 if isinstance(number, float | np.floating) else np.int64
    return int(np.array(number, kind).view(np.int64))


class Block:
    """A block of bytes in which arrays have places. Arrays that share memory share it here."""

    def __init__(self, start: int = 0):
        self.size, self._spans = start, []

    def add(self, arrays: Sequence[np.ndarray]) -> None:
        """Give arrays places in this order; overlapping ones share a place."""
        spans = []
        for array in arrays:
            low = array.__array_interface__["data"][0]
            if array.nbytes:
                spans.append((low, low + array.nbytes))
        merged: list[list[int]] = []
        for low, high in sorted(spans):
            if merged and low < merged[-1][1]:
                merged[-1][1] = max(merged[-1][1], high)
            else:
                merged.append([low, high])
        order = {low: number for number, (low, _) in reversed(list(enumerate(spans)))}
        for low, high in sorted(merged, key=lambda span: order[span[0]]):
            at = -(-self.size // ALIGNMENT) * ALIGNMENT
            self._spans.append((low, high, at))
            self.size = at + high - low

    def place(self, array: np.ndarray) -> int | None:
        """Where an array begins; None if it is not in the block."""
        address = array.__array_interface__["data"][0]
        return next((at + address - low for low, high, at in self._spans if low <= address < high), None)

    def fill(self, image: np.ndarray, arrays: Sequence[np.ndarray]) -> None:
        """Write the arrays' bytes at their places of `image`."""
        for array in arrays:
            at = self.place(array)
            if at is not None:
                image[at : at + array.nbytes] = np.frombuffer(array.tobytes(), np.uint8)


@dataclass
class Piece:
    """A part of a tick between two discontinuities of the path, with its own steps."""

    level: int
    tick: int
    begin: float
    length: float
    end: float
    count: int
    scheme: int

    @property
    def words(self) -> list[int]:
        """The piece as the struct `Piece` in world.c."""
        return [self.level, self.tick, *map(bits, (self.begin, self.length, self.end)), self.count, self.scheme]


@dataclass
class Memory:
    """The data of a unit."""

    names: list[str]
    """Names of the words."""
    words: list[int]
    """Values of the words in a new instance: numbers, or places."""
    kinds: list[int]
    """Kind of each word: NUMBER, OWN or SHARED."""
    schemes: list[list[int]]
    """Words of the integrator's constants: for each level of the step, then for pieces of ticks."""
    pieces: list[Piece]
    own: np.ndarray
    """The memory of a new instance, bytes."""
    shared: np.ndarray
    """The constants, bytes."""
    state_size: int
    """Bytes of the state at the beginning of `own`; scratch arrays follow."""
    places: dict[str, int]
    """Where the named arrays begin in `own`."""

    def word(self, name: str) -> int:
        """The index of the word with this name."""
        return self.names.index(name)


def lay_out(
    arguments: Mapping[str, Any],
    state: Mapping[str, np.ndarray],
    scratch: Mapping[str, np.ndarray],
    schemes: Sequence[Scheme] = (),
    pieces: Sequence[Piece] = (),
) -> Memory:
    """The memory of a unit that calls a kernel with these arguments.

    The arrays in `state` are the unit's state and those in `scratch` may change; all others are constant.
    """
    labelled = [item for name, value in arguments.items() for item in words_of(value, name)]
    arrays = [value for _, value in labelled if isinstance(value, np.ndarray)]
    further = [value for each in schemes for _, value in words_of(tuple(each), "") if isinstance(value, np.ndarray)]
    own, shared = Block(HEAD), Block()
    own.add(list(state.values()))
    state_size = -(-own.size // ALIGNMENT) * ALIGNMENT
    own.add([array for array in scratch.values() if own.place(array) is None])
    shared.add([array for array in (*arrays, *further) if own.place(array) is None])

    def word(value: Any) -> tuple[int, int]:
        if not isinstance(value, np.ndarray):
            return bits(value), NUMBER
        at = own.place(value)
        return (shared.place(value) or 0, SHARED) if at is None else (at, OWN)

    found = [word(value) for _, value in labelled]
    own_image, shared_image = np.zeros(own.size, np.uint8), np.zeros(max(shared.size, 1), np.uint8)
    own.fill(own_image, [*state.values(), *scratch.values()])
    shared.fill(shared_image, [*arrays, *further])
    places = {name: own.place(array) for name, array in (*state.items(), *scratch.items())}
    return Memory(
        [name for name, _ in labelled],
        [value for value, _ in found],
        [kind for _, kind in found],
        [[word(value)[0] for _, value in words_of(tuple(each), "")] for each in schemes],
        list(pieces),
        own_image,
        shared_image,
        state_size,
        {name: at for name, at in places.items() if at is not None},
    )


def arrays_of(workspace: Workspace) -> dict[str, np.ndarray]:
    """The arrays of a workspace, as scratch."""
    return {name: value for name, value in words_of(workspace, "ws") if isinstance(value, np.ndarray)}


def schemes_of(assembly: Assembly) -> tuple[list[Scheme], list[Piece]]:
    """The integrator's constants of all levels and of pieces of split ticks, and those pieces."""
    levels = assembly.watch.most + 1
    schemes, pieces, known = [assembly.levels.scheme(level) for level in range(levels)], [], {}
    for level in range(levels):
        dt, tick = assembly.tick_period / (assembly.step_count << level), 0
        while (split := next_split_tick(assembly, level, tick)) is not None:
            tick = split.number + 1
            for begin, end in zip(split.cuts[:-1], split.cuts[1:], strict=True):
                length = end - begin
                count = steps_in(length, dt)
                if length / count not in known:
                    known[length / count] = len(schemes)
                    schemes.append(build_scheme(assembly.levels.integrator, assembly.beam, length / count))
                pieces.append(Piece(level, split.number, begin, length, end, count, known[length / count]))
    return schemes, pieces
