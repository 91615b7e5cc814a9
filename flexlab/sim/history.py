"""The last half minute of the current run at full rate, for plots."""

import threading

import numpy as np

from flexlab.sim import row_layout
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK

HISTORY_SECONDS = 30.0
"""Longest window that plots offer, s."""


class History:
    """A ring of sample rows; written by the runner, copied out by anyone."""

    def __init__(self, row_length: int, arm_count: int):
        self._rows = np.zeros((int(HISTORY_SECONDS / TICK) + 1, row_length))
        self._arm_count = arm_count
        self._written = 0
        self._lock = threading.Lock()

    def append(self, rows: np.ndarray) -> None:
        """Add rows (N, row length), at most the ring's size at once."""
        size = len(self._rows)
        rows = rows[-size:]
        with self._lock:
            start = self._written % size
            first = min(len(rows), size - start)
            self._rows[start : start + first] = rows[:first]
            self._rows[: len(rows) - first] = rows[first:]
            self._written += len(rows)

    def recent(self, seconds: float) -> Samples:
        """A copy of the last `seconds`, oldest first."""
        size = len(self._rows)
        with self._lock:
            count = min(max(round(seconds / TICK), 0) + 1, size, self._written)
            start = (self._written - count) % size
            first = min(count, size - start)
            rows = np.concatenate([self._rows[start : start + first], self._rows[: count - first]])
        return row_layout.rows_to_samples(rows, self._arm_count)
