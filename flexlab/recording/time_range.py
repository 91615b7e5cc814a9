"""A range of simulation time out of a run."""

from collections.abc import Iterable, Iterator

import numpy as np

from flexlab.errors import RecordingError
from flexlab.sim.samples import Samples


def within(blocks: Iterable[Samples], start: float | None, end: float | None) -> Iterator[Samples]:
    """The samples with start <= time <= end (s; None: no limit), in blocks of N >= 1. `blocks`: in the order of time.

    Reads no further than needed. Raises `RecordingError` if there are none.
    """
    low, high = -np.inf if start is None else start, np.inf if end is None else end
    first = last = None
    found = False
    for block in blocks:
        if len(block) == 0:
            continue
        first, last = float(block.time[0]) if first is None else first, float(block.time[-1])
        row, stop = np.searchsorted(block.time, low, "left"), np.searchsorted(block.time, high, "right")
        if row < stop:
            found = True
            yield block.slice(int(row), int(stop))
        elif found:
            return
    if first is None:
        raise RecordingError("The run has no samples.")
    if not found:
        low, high = first if start is None else start, last if end is None else end
        raise RecordingError(
            f"From {low:g} to {high:g} s there is no sample: choose times within {first:g} to {last:g} s."
        )
