"""Where each signal of `Samples` stands in a row that the kernel writes (see `sim.signals`)."""

from collections.abc import Sequence

import numpy as np

from flexlab.signal import ARM, Signal
from flexlab.sim.samples import Samples
from flexlab.sim.signals import ARMS, COLUMN, OF_EACH_ARM, OF_THE_BEAM, PER_ARM, PER_SAMPLE

TIME, POSE = COLUMN["time"], COLUMN["pose"]


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
    """Where a signal that begins at column `first` begins and ends, and its shape but for arms."""
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
