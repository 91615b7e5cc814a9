"""The last minute of the current run at full rate, for plots and to look back at."""

import threading
from collections.abc import Sequence

import numpy as np

from flexlab.signal import Signal
from flexlab.sim import row_layout
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK

HISTORY_SECONDS = 60.0
"""How far a person can look back, s; longer than any window that plots offer."""


class History:
    """A ring of sample rows; written by the runner, copied out by anyone."""

    def __init__(self, row_length: int, arm_count: int, own: Sequence[Signal] = ()):
        """`own`: the law's own signals, which stand at the rows' ends."""
        self._rows = np.zeros((int(HISTORY_SECONDS / TICK) + 1, row_length))
        self._arm_count, self._own = arm_count, tuple(own)
        self._written = 0
        self._lock = threading.Lock()

    def append(self, rows: np.ndarray, own: Sequence[Signal] = ()) -> None:
        """Add rows (N, row length), at most the ring's size at once. `own`: as of the law that is now at work."""
        size = len(self._rows)
        rows = rows[-size:]
        with self._lock:
            if tuple(own) != self._own:
                self._follow(rows.shape[1], tuple(own))
            start = self._written % size
            first = min(len(rows), size - start)
            self._rows[start : start + first] = rows[:first]
            self._rows[: len(rows) - first] = rows[first:]
            self._written += len(rows)

    def _follow(self, row_length: int, own: tuple[Signal, ...]) -> None:
        """Another law came in: what it shows of itself has no past."""
        shared = row_length - sum(signal.fixed_size for signal in own)
        rows = np.full((len(self._rows), row_length), np.nan)
        rows[:, :shared] = self._rows[:, :shared]
        self._rows, self._own = rows, own

    def recent(self, seconds: float, ago: int = 0) -> Samples:
        """A copy of the last `seconds`, oldest first, as they were `ago` samples earlier (as far as the ring goes back)."""
        size = len(self._rows)
        with self._lock:
            kept = min(size, self._written)
            ago = min(ago, max(kept - 1, 0))
            count = min(max(round(seconds / TICK), 0) + 1, kept - ago)
            start = (self._written - ago - count) % size
            first = min(count, size - start)
            own = self._own
            rows = np.concatenate([self._rows[start : start + first], self._rows[: count - first]])
        return row_layout.rows_to_samples(rows, self._arm_count, own)
