"""The memory of a unit: arrays as two blocks of bytes, and a kernel's arguments as words that point into them.

One block is constant and shared by all instances. Each instance has its own copy of the other: first what changes with time,
which is an instance's whole state, then the kernels' scratch arrays.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexlab.physics.plant import Workspace
from flexlab.sim.assembly import Assembly
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.step_size import build_scheme
from flexlab.sim.stepping import next_split_tick, steps_in

ALIGNMENT = 64
"""Bytes: a line of a processor's cache."""
HEAD, CLOCK = 4 * 8, 3 * 8
"""Bytes of an instance's state before its arrays: tick, level of the step, whether it has stopped, time (`State` in unit.h);
and where among them the time stands."""
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
        """As `Piece` in unit.c."""
        return [self.level, self.tick, *map(bits, (self.begin, self.length, self.end)), self.count, self.scheme]


@dataclass
class Memory:
    """The data of a unit."""

    names: list[str]
    """Of the words."""
    words: list[int]
    """Their values in an instance that has just been made: numbers, or places."""
    kinds: list[int]
    """NUMBER, OWN or SHARED, of each word."""
    schemes: list[list[int]]
    """Words of the integrator's constants: of each level of the step, then of pieces of ticks."""
    pieces: list[Piece]
    own: np.ndarray
    """The memory of an instance that has just been made, bytes."""
    shared: np.ndarray
    """The constants, bytes."""
    state_size: int
    """Bytes of `own` that change with time and are no scratch."""
    places: dict[str, int]
    """Where the named arrays begin in `own`."""

    def word(self, name: str) -> int:
        """Number of the word of this name."""
        return self.names.index(name)


def lay_out(
    arguments: Mapping[str, Any],
    state: Mapping[str, np.ndarray],
    scratch: Mapping[str, np.ndarray],
    schemes: Sequence[Scheme] = (),
    pieces: Sequence[Piece] = (),
) -> Memory:
    """The memory of a unit that calls a kernel with these arguments.

    Of their arrays those in `state` are what a unit goes on from, and those in `scratch` may change; all others are constant.
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
