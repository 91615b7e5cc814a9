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
    signals = {s.name: _part(rows, s, COLUMN[s.name]) for s in PER_SAMPLE}
    for signal in OF_EACH_ARM:
        signals[signal.name] = _part(arms, signal, COLUMN[signal.name])
    for number, signal in enumerate(OF_THE_BEAM):
        signals[signal.name] = rows[:, beam + number * n_q : beam + (number + 1) * n_q]
    for signal in own:
        signals[signal.name] = _part(rows, signal, last)
        last += signal.fixed_size
    return Samples(**signals)


def _part(rows: np.ndarray, signal: Signal, first: int) -> np.ndarray:
    """A signal's columns of the last axis, in its own shape."""
    inner = tuple(len(axis.labels) for axis in signal.axes if axis != ARM)
    if not inner:
        return rows[..., first]
    part = rows[..., first : first + signal.fixed_size]
    return part if len(inner) == 1 else part.reshape(*part.shape[:-1], *inner)


def empty_samples(arm_count: int, coordinate_count: int, own: Sequence[Signal] = ()) -> Samples:
    """Samples of no instant."""
    return rows_to_samples(np.zeros((0, row_length(arm_count, coordinate_count, own))), arm_count, own)
