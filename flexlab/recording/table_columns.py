"""Every signal of `Samples` as named columns with units, for tables, and back."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from flexlab.errors import RecordingError
from flexlab.plain_text import visible
from flexlab.scenario import Scenario
from flexlab.signal import ARM, COORDINATE, Axis, Signal
from flexlab.sim.geometry import held_columns
from flexlab.sim.samples import Samples
from flexlab.sim.signals import TABLE, known_signals, own_signals

LONGEST_SHOWN = 60
"""Characters of a column's name that a sentence repeats."""
MOST_SHOWN = 8
"""Columns that a sentence names."""


@dataclass(frozen=True)
class Column:
    """One number per sample."""

    name: str
    """Signal, part and unit: "joint_torque_left_2 [N·m]"."""
    signal: str
    """Field of `Samples`."""
    index: tuple[int, ...]
    """Which entry of one row of that field; () if it is a number."""


def table_columns(scenario: Scenario, later: Iterable[Scenario] = ()) -> tuple[Column, ...]:
    """All columns of a run of `scenario`, in the order of the table of signals, then the law's own.

    `later`: the scenarios that changes made of it, whose laws may have other signals of their own.
    """
    own = {signal.name: signal for each in (scenario, *later) for signal in own_signals(each)}
    return tuple(column for signal in (*TABLE.values(), *own.values()) for column in _columns(signal, scenario))


def _columns(signal: Signal, scenario: Scenario) -> list[Column]:
    return [
        Column(f"{'_'.join([signal.name, *words])} [{unit}]", signal.name, index)
        for words, unit, index in _parts(signal, scenario)
    ]


def _parts(signal: Signal, scenario: Scenario) -> list[tuple[tuple[str, ...], str, tuple[int, ...]]]:
    """(words, unit, index) of each entry of one row of a signal."""
    parts: list[tuple[tuple[str, ...], str, tuple[int, ...]]] = [((), signal.units[0], ())]
    for axis in signal.axes:
        parts = [
            (words + label, signal.units[kind % len(signal.units)], (*index, place))
            for words, _, index in parts
            for place, (label, kind) in enumerate(_labels(axis, scenario))
        ]
    return parts


def _labels(axis: Axis, scenario: Scenario) -> list[tuple[tuple[str, ...], int]]:
    """(words, number of the unit) of each entry along an axis."""
    if axis == COORDINATE:
        nodal = range(2 * (scenario.payload.element_count + 1))
        held = held_columns(scenario.payload)
        return [((f"node{c // 2}", axis.labels[c % 2]), c % 2) for c in nodal if c not in held]
    labels = axis.labels[: len(scenario.arms)] if axis == ARM else axis.labels
    return [((label,), number) for number, label in enumerate(labels)]


def to_columns(samples: Samples, columns: Sequence[Column]) -> dict[str, np.ndarray]:
    """Name → values (N,) of every column; NaN for what these samples do not have."""
    nothing = np.full(len(samples), np.nan)
    own = samples.own
    return {
        column.name: np.ascontiguousarray(samples[column.signal][(slice(None), *column.index)])
        if column.signal in TABLE or column.signal in own
        else nothing
        for column in columns
    }


def check_units(names: Iterable[str], scenario: Scenario) -> None:
    """Raises `RecordingError` for the column of a known signal that has another unit: it would be left out."""
    units = {
        "_".join([signal.name, *words]): unit
        for signal in known_signals().values()
        for words, unit, _ in _parts(signal, scenario)
    }
    for column in names:
        name, _, unit = column.partition(" [")
        known = units.get(name)
        if known is not None and unit != f"{known}]":
            shown = visible(column, LONGEST_SHOWN)
            raise RecordingError(f"The column {shown!r} has a unit that is not known for it: give {name} [{known}].")


def _whole_signals(names: Collection[str], scenario: Scenario) -> Iterator[list[Column]]:
    """The columns of each signal that is there with all of them."""
    for signal in known_signals().values():
        columns = _columns(signal, scenario)
        if columns and all(column.name in names for column in columns):
            yield columns


def left_out_text(names: Collection[str], scenario: Scenario) -> str:
    """A sentence that names the columns that `from_columns` makes nothing of; empty: there are none."""
    taken = {column.name for columns in _whole_signals(names, scenario) for column in columns}
    left = [repr(visible(name, LONGEST_SHOWN)) for name in names if name not in taken]
    if not left:
        return ""
    more = f" and {len(left) - MOST_SHOWN} more" if len(left) > MOST_SHOWN else ""
    return f"Columns left out, of no signal that is known here and whole: {', '.join(left[:MOST_SHOWN])}{more}."


def from_columns(values: dict[str, np.ndarray], scenario: Scenario) -> Samples:
    """The samples that `to_columns` was given, read-only. Raises KeyError if there is no column of times.

    A signal whose columns are not all there is absent.
    """
    signals: dict[str, np.ndarray] = {}
    for columns in _whole_signals(values, scenario):
        shape = tuple(1 + max(places) for places in zip(*(column.index for column in columns), strict=True))
        array = np.empty((len(values[columns[0].name]), *shape))
        for column in columns:
            array[(slice(None), *column.index)] = values[column.name]
        array.flags.writeable = False
        signals[columns[0].signal] = array
    if "time" not in signals:
        raise KeyError("time [s]")
    return Samples(**signals)
