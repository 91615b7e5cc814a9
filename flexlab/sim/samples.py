"""What the engine hands out: read-only blocks of samples in SI units, their row layout, and states from which runs go on."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from flexlab.control.law import law_of
from flexlab.errors import ScenarioError
from flexlab.scenario import Scenario
from flexlab.signal import ARM, COORDINATE, Signal, signal_lines, table
from flexlab.sim.signals import (
    ARMS,
    COLUMN,
    DERIVED,
    OF_EACH_ARM,
    OF_THE_BEAM,
    PER_ARM,
    PER_SAMPLE,
    TABLE,
    Signals,
    own_signals,
)
from flexlab.text import counted, number_text


@table
class Samples(Signals):
    """Read-only arrays of signals at the instants `time` (N,), by name.

    A signal that was not recorded is absent: it reads as NaN, and `absent` names it. Signals that no row of the table has
    (a law's own, or a newer version's) are attributes like the others, and `own` holds them.
    """

    def __init__(self, **signals: np.ndarray):
        self.__setstate__(signals)

    def __setstate__(self, parts: dict[str, Any]) -> None:
        """Take signals and whatever else a copy or a pickle has; arrays become read-only."""
        vars(self).update(parts)
        for name, array in self.signals().items():
            if array.flags.writeable:  # Its owner may go on to write.
                view = vars(self)[name] = array.view()
                view.flags.writeable = False

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        span = f"t = {number_text(self.time[0])} to {number_text(self.time[-1])} s" if len(self) else "no instants"
        return f"{type(self).__name__}({counted(len(self), 'sample')}, {span})"

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> np.ndarray:
            signals = vars(self)
            if name not in TABLE or "time" not in signals:
                known = ", ".join([*TABLE, *DERIVED, *(n for n in signals if n not in TABLE)])
                raise AttributeError(f"samples have no signal {name}: there are {known}.", name=name, obj=self)
            shape = TABLE[name].shape(*self._sizes())
            return np.broadcast_to(np.nan, (len(self), *shape))

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a signal by its name. Raises TypeError for anything else, such as a row number."""
        if not isinstance(name, str):
            raise TypeError(
                f"[{name!r:.60}] names no signal: give a name, as in ['pose'], or take rows by take([0, 1])."
            )
        return getattr(self, name)

    def _sizes(self) -> tuple[int, int]:
        """Numbers of arms and beam coordinates, from the signals that are present."""
        shapes = {
            axis: array.shape[1 + place]
            for name, array in self.signals().items()
            if name in TABLE
            for place, axis in enumerate(TABLE[name].axes)
        }
        return shapes.get(ARM, 0), shapes.get(COORDINATE, 0)

    def signals(self) -> dict[str, np.ndarray]:
        """All signals that are present, by name: those of the table in its order, then own ones."""
        present = {name: vars(self)[name] for name in TABLE if name in vars(self)}
        return present | self.own

    @property
    def own(self) -> dict[str, np.ndarray]:
        """The signals that are not in the table."""
        return {n: array for n, array in vars(self).items() if n not in TABLE and isinstance(array, np.ndarray)}

    @property
    def absent(self) -> frozenset[str]:
        """Names of the signals in the table that were not recorded."""
        return frozenset(name for name in TABLE if name not in vars(self))

    def having(self, **signals: np.ndarray) -> "Samples":
        """The same samples with some signals replaced or added."""
        return Samples(**{**self.signals(), **signals})

    def take(self, rows: Any) -> "Samples":
        """Return the samples at an index of the first axis: a slice, or an array of integers or booleans.

        Raises TypeError for anything else, such as one integer.
        """
        if not isinstance(rows, slice) and np.ndim(rows) != 1:
            raise TypeError(f"take({rows!r:.60}) names no rows: give a slice or a list, as in take([0, 1]).")
        return Samples(**{name: array[rows] for name, array in self.signals().items()})

    def slice(self, start: int, stop: int) -> "Samples":
        """Return rows start..stop as a separate block (views, read-only like their source)."""
        return self.take(slice(start, stop))


def join_blocks(blocks: list[Samples]) -> Samples:
    """Join blocks end to end. Beam coordinates of coarser meshes are padded with NaN to the width of the finest.

    Signals that some blocks lack are NaN there, such as those of a law that was not always in force.
    """
    joined: dict[str, np.ndarray] = {}
    rows = sum(map(len, blocks))
    every = [block.signals() for block in blocks]
    for name in dict.fromkeys(name for signals in every for name in signals):
        widest = max(signals[name].shape[1:] for signals in every if name in signals)
        whole = np.full((rows, *widest), np.nan)
        first = 0
        for block, signals in zip(blocks, every, strict=True):
            if name in signals:
                part = signals[name]
                whole[(slice(first, first + len(part)), *map(slice, part.shape[1:]))] = part
            first += len(block)
        joined[name] = whole
    return Samples(**joined)


MEASURED = "measured"
"""Status of a run that is somebody's own measurement."""


class Status(str):
    """The status of a run, as a string: "running", "finished", "measured", "diverged", "unreachable", "singular".

    "measured" is no simulation but somebody's own data, see `recording.measurement`. Compares as its name; `text` is the
    sentence that the user reads, `time` the simulation time in s.
    """

    text: str
    time: float

    def __new__(cls, name: str, text: str = "", time: float = 0.0) -> "Status":
        """Make the value `name`; `text` defaults to the name."""
        status = super().__new__(cls, name)
        status.text = text or name
        status.time = time
        return status

    @property
    def failed(self) -> bool:
        """Whether the run stopped before its end."""
        return self not in ("running", "finished", MEASURED)


@table
class Run(Samples):
    """A finished simulation: all samples, the `scenario` it started from, and the `status` with which it ended.

    A failed run holds the good samples up to the failure.
    """

    scenario: Scenario
    status: Status

    def __init__(self, *, scenario: Scenario, status: Status, **signals: np.ndarray):
        super().__init__(**signals)
        vars(self).update(scenario=scenario, status=status)


_LIST = f"""

    Arrays on the N instants, of `arms` arms and n_q beam coordinates (SI units; the second half follows from the first):

{signal_lines(TABLE.values())}

{signal_lines(DERIVED.values())}
"""
for _sort in (Samples, Run):
    _sort.__doc__ = f"{(_sort.__doc__ or '').rstrip()}{_LIST}"


OF_THE_INTERFACE = (
    "name", "metrics", "explanations", "result_hash", "save", "plot", "show", "to_arrow", "to_pandas", "to_xarray",
)  # fmt: skip
"""Further attributes of `flexlab.Run`."""
TAKEN = {*TABLE, *DERIVED, *dir(Run), *vars(Run)["__annotations__"], *OF_THE_INTERFACE}
"""Names that every run has."""


def check_signal_names(scenario: Scenario) -> None:
    """Raise `ScenarioError` if a law's own signal has the name of something else in a run."""
    names = [signal.name for signal in own_signals(scenario)]
    for signal in law_of(scenario.controller).signals:
        if signal.name in TAKEN or names.count(signal.name) > 1:
            text = f"The control law {scenario.controller.kind} has a signal {signal.name}, which every run has: "
            raise ScenarioError([("controller.kind", f"{text}give its readout, or the unit's output, another name.")])


def row_length(arm_count: int, coordinate_count: int, own: Sequence[Signal] = ()) -> int:
    """Columns of one sample. `own`: the law's own signals."""
    beam = len(OF_THE_BEAM) * coordinate_count
    return ARMS + PER_ARM * arm_count + beam + sum(signal.fixed_size for signal in own)


def rows_to_samples(rows: np.ndarray, arm_count: int, own: Sequence[Signal] = ()) -> Samples:
    """Read-only views of the signals in rows (N, row length). `own`: the law's own signals."""
    rows = rows.view()
    rows.flags.writeable = False
    count, width = rows.shape
    beam = ARMS + PER_ARM * arm_count
    last = width - sum(signal.fixed_size for signal in own)
    n_q = (last - beam) // len(OF_THE_BEAM)
    arms = rows[:, ARMS:beam].reshape(count, arm_count, PER_ARM)
    signals = {name: _part(rows, *place) for name, place in _OF_A_SAMPLE.items()}
    for name, place in _OF_AN_ARM.items():
        signals[name] = _part(arms, *place)
    for number, signal in enumerate(OF_THE_BEAM):
        signals[signal.name] = rows[:, beam + number * n_q : beam + (number + 1) * n_q]
    for signal in own:
        signals[signal.name] = _part(rows, *_place(signal, last))
        last += signal.fixed_size
    return Samples(**signals)


def _place(signal: Signal, first: int) -> tuple[int, int, tuple[int, ...]]:
    """First and end column of a signal that begins at column `first`, and its shape without the axis of arms."""
    return first, first + signal.fixed_size, tuple(len(axis.labels) for axis in signal.axes if axis != ARM)


_OF_A_SAMPLE = {signal.name: _place(signal, COLUMN[signal.name]) for signal in PER_SAMPLE}
_OF_AN_ARM = {signal.name: _place(signal, COLUMN[signal.name]) for signal in OF_EACH_ARM}


def _part(rows: np.ndarray, first: int, end: int, shape: tuple[int, ...]) -> np.ndarray:
    """A signal's columns of the last axis, in its own shape."""
    if not shape:
        return rows[..., first]
    part = rows[..., first:end]
    return part if len(shape) == 1 else part.reshape(*part.shape[:-1], *shape)


def empty_samples(arm_count: int, coordinate_count: int, own: Sequence[Signal] = ()) -> Samples:
    """Samples of no instant."""
    return rows_to_samples(np.zeros((0, row_length(arm_count, coordinate_count, own))), arm_count, own)


@dataclass(frozen=True)
class WorldState:
    """A copy of everything that changes with time: enough to continue a run bit for bit in the same scenario."""

    tick: int
    y: np.ndarray
    """State of `physics.plant`."""
    held_torque: np.ndarray
    """(arms, 3), N·m."""
    torque_line: np.ndarray
    """(delay + 1, arms, 3), N·m."""
    pull: np.ndarray
    """A `physics.plant.Hand`, (6,)."""


@dataclass(frozen=True)
class Origin:
    """The instant of an earlier run from which a run goes on."""

    run: str
    """The earlier run's name: that of its file."""
    time: float
    """Simulation time, s."""
    state: WorldState = field(compare=False)
    """The state at that instant."""
