"""Every signal of `Samples` as named columns with units, for tables, and back; and checks of imported runs."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from flexlab.boundaries import held_coordinates
from flexlab.errors import RecordingError
from flexlab.scenario import Scenario
from flexlab.signal import ARM, COORDINATE, Axis, Signal
from flexlab.sim.samples import Samples
from flexlab.sim.signals import DERIVED, TABLE, known_signals, own_signals
from flexlab.sim.snapshot import LONGEST_PERIOD, SHORTEST_PERIOD, Event
from flexlab.text import range_text, visible

LONGEST_SHOWN = 60
"""Largest length of a column's name in a sentence, characters."""
MOST_SHOWN = 8
"""Largest number of columns that a sentence names."""


@dataclass(frozen=True)
class Column:
    """One number per sample."""

    name: str
    """Signal, part and unit: "joint_torque_left_2 [N·m]"."""
    signal: str
    """Field of `Samples`."""
    index: tuple[int, ...]
    """Index within one row of that field; () for a number."""

    @property
    def part(self) -> str:
        """The name without its unit."""
        return self.name.partition(" [")[0]

    @property
    def unit(self) -> str:
        """The unit, SI."""
        return self.name.partition(" [")[2].removesuffix("]")


def table_columns(scenario: Scenario, later: Iterable[Scenario] = (), derived: bool = False) -> tuple[Column, ...]:
    """All columns of a run of `scenario`: those of the table of signals, of the law's own, and, if `derived`, of derived ones.

    `later`: the scenarios after changes, whose laws may have other signals of their own.
    """
    own = {signal.name: signal for each in (scenario, *later) for signal in own_signals(each)}
    signals = (*TABLE.values(), *own.values(), *(DERIVED.values() if derived else ()))
    return tuple(column for signal in signals for column in signal_columns(signal, scenario))


def signal_columns(signal: Signal, scenario: Scenario) -> list[Column]:
    """The columns of one signal."""
    parts: list[tuple[tuple[str, ...], str, tuple[int, ...]]] = [((signal.name,), signal.units[0], ())]
    for axis in signal.axes:
        parts = [
            (words + label, signal.units[kind % len(signal.units)], (*index, place))
            for words, _, index in parts
            for place, (label, kind) in enumerate(axis_labels(axis, scenario))
        ]
    return [Column(f"{'_'.join(words)} [{unit}]", signal.name, index) for words, unit, index in parts]


def axis_labels(axis: Axis, scenario: Scenario) -> list[tuple[tuple[str, ...], int]]:
    """(words, number of the unit) of each entry along an axis."""
    if axis == COORDINATE:
        nodal = range(2 * (scenario.payload.element_count + 1))
        held = held_coordinates(scenario.payload.element_count, scenario.payload.boundary)
        return [((f"node{c // 2}", axis.labels[c % 2]), c % 2) for c in nodal if c not in held]
    labels = axis.labels[: len(scenario.arms)] if axis == ARM else axis.labels
    return [((label,), number) for number, label in enumerate(labels)]


def to_columns(samples: Samples, columns: Sequence[Column]) -> dict[str, np.ndarray]:
    """Name → values (N,) of every column; NaN for a signal that the samples lack."""
    nothing = np.full(len(samples), np.nan)
    own = samples.own
    return {
        column.name: np.ascontiguousarray(samples[column.signal][(slice(None), *column.index)])
        if column.signal in TABLE or column.signal in own
        else nothing
        for column in columns
    }


NO_NUMBERS = {"c": "complex numbers", "S": "text", "U": "text", "M": "dates", "m": "durations"}
"""NumPy's kinds of arrays that are not real numbers, though most can be converted."""


def from_columns(values: dict[str, np.ndarray], scenario: Scenario) -> tuple[Samples, str]:
    """The samples given to `to_columns`, read-only, and a sentence that names the columns of no signal, or "".

    A signal without all its columns is absent. Raises `RecordingError` if there is no column of times, if a column does not
    hold one real number per row, and if a column of a known signal has another unit, as it would be left out.
    """
    known = {signal: signal_columns(signal, scenario) for signal in known_signals().values()}
    right = {column.part: column.name for columns in known.values() for column in columns}
    for name in values:
        if name != (due := right.get(name.partition(" [")[0], name)):
            shown = visible(name, LONGEST_SHOWN)
            raise RecordingError(f"The column {shown!r} has a unit that is not known for it: give {due}.")
    if "time [s]" not in values:
        raise RecordingError("There is no column time [s]: give every row its time.")
    signals: dict[str, np.ndarray] = {}
    left = dict.fromkeys(values)
    rows = len(values["time [s]"])
    size = len(scenario.arms), scenario.payload.coordinate_count
    for signal, columns in known.items():
        if not columns or any(column.name not in values for column in columns):
            continue
        array = np.empty((rows, *signal.shape(*size)))
        for column in columns:
            given = values[column.name]
            if given.shape != (rows,) or given.dtype.kind in NO_NUMBERS:
                kind = f"{NO_NUMBERS.get(given.dtype.kind, 'values')} of shape {given.shape}"
                raise RecordingError(
                    f"The column {column.name!r} holds {kind}: give {rows} real numbers, one per time."
                )
            array[(slice(None), *column.index)] = given
            left.pop(column.name, None)
        signals[signal.name] = array
    for axis, name in TOLD_BY.items():
        # Without any signal of arms, or of beam coordinates, samples would have no arms, or no coordinates, to draw.
        if not any(axis in TABLE[known].axes for known in signals if known in TABLE):
            signals[name] = np.full((rows, *TABLE[name].shape(*size)), np.nan)
    return Samples(**signals), _left_out_text(list(left))


def _left_out_text(names: list[str]) -> str:
    if not names:
        return ""
    shown = ", ".join(repr(visible(name, LONGEST_SHOWN)) for name in names[:MOST_SHOWN])
    more = f" and {len(names) - MOST_SHOWN} more" if len(names) > MOST_SHOWN else ""
    return f"Columns left out, of no signal that is known here and whole: {shown}{more}."


TOLD_BY: dict[Axis, str] = {ARM: "joint_angle", COORDINATE: "beam_coordinates"}
"""Axis → a signal whose array gives its length."""
LAST_TIME = 1e9
"""Largest magnitude of a time, s: 32 years; rerun counts nanoseconds in 64 bits."""
CLOSEST = 1e-9
"""Smallest difference between two times, s: rerun's resolution."""
ROUNDING = 1e-6
"""Relative tolerance of a period that was computed from two times."""
LEVELS = ("info", "warning", "error")
LONGEST_EVENT = 10_000
"""Largest length of an event's text, characters."""


def checked_blocks(name: str, blocks: Iterable[Samples]) -> Iterator[Samples]:
    """The blocks of the file `name`. Raises `RecordingError` if their times are not finite and rising."""
    rows, last = 0, -math.inf
    for block in blocks:
        check_times(name, block.time, rows, last)
        if len(block):
            rows, last = rows + len(block), float(block.time[-1])
        yield block


def check_times(name: str, time: np.ndarray, before: int = 0, last: float = -math.inf) -> None:
    """Refuse times, s, that are not finite or not rising by `CLOSEST`. Raises `RecordingError`, which counts rows from 1.

    `before`: number of rows before them, the last of which has the time `last`.
    """
    usable = np.abs(time) <= LAST_TIME  # False for NaN too.
    with np.errstate(invalid="ignore"):  # `usable` tells the difference of two infinities.
        rising = np.diff(time, prepend=last) >= CLOSEST if len(time) else usable
    wrong = np.flatnonzero(~(usable & rising))
    if not len(wrong):
        return
    row = int(wrong[0])
    where, value = f"{name}, row {before + row + 1}: time = {time[row]:.12g} s", float(time[row])
    if not usable[row]:
        reason = "is not finite" if not math.isfinite(value) else f"is beyond ±{LAST_TIME:g} s"
        raise RecordingError(f"{where} {reason}: give every row a time in s, each later than the one before.")
    earlier = last if row == 0 else float(time[row - 1])
    raise RecordingError(
        f"{where} is not later than the {earlier:.12g} s of the row before by 1 ns or more: sort the rows by time."
    )


def check_period(name: str, period: object) -> float:
    """The sample period in s. Raises `RecordingError` for one that no run can have."""
    value = period if isinstance(period, (int, float)) and not isinstance(period, bool) else math.nan
    if not (1 - ROUNDING) * SHORTEST_PERIOD <= value <= (1 + ROUNDING) * LONGEST_PERIOD:
        allowed = f"{range_text(SHORTEST_PERIOD, LONGEST_PERIOD)} s"
        shown = visible(repr(period), 40)
        raise RecordingError(f"{name}: the sample period {shown} s is not usable: it must be {allowed}.")
    return float(value)


def check_events(name: str, events: Iterable[Event]) -> None:
    """Refuse events that cannot be shown or replayed. Raises `RecordingError`, which counts events from 1."""
    for number, event in enumerate(events, 1):
        where = f"{name}, event {number}"
        if not isinstance(event.time, (int, float)) or not abs(event.time) <= LAST_TIME:
            shown = visible(repr(event.time), 40)
            raise RecordingError(f"{where}: time = {shown} s is not a finite time within ±{LAST_TIME:g} s.")
        if event.level not in LEVELS:
            raise RecordingError(f"{where}: level {visible(repr(event.level), 40)} is not one of {', '.join(LEVELS)}.")
        if len(event.text) > LONGEST_EVENT:
            raise RecordingError(f"{where}: its text has {len(event.text)} characters, over {LONGEST_EVENT}.")
