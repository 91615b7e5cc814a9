"""When a vibration has died away, told from blocks of any order and number in little memory."""

import numpy as np

SETTLED = 0.05
"""Share of its peak under which a vibration counts as gone."""


class Settling:
    """Gathers a signal (N,) over `time` (N,), s; `result` says how long it was louder than `SETTLED` of its peak.

    Which share of the final peak an instant reaches is known at the end only. But an instant that is followed by a louder
    one can never be the last loud one, so few have to be kept: of a ring, its last period.
    """

    def __init__(self) -> None:
        self._first = np.inf
        self._peak = 0.0
        self._time = np.empty(0)
        self._size = np.empty(0)

    def add(self, time: np.ndarray, signal: np.ndarray) -> None:
        """Take in a block."""
        if len(time) == 0:
            return
        size = np.abs(signal)
        self._first = min(self._first, float(np.min(time)))
        self._peak = max(self._peak, float(np.max(size)))
        time, size = np.concatenate([self._time, time]), np.concatenate([self._size, size])
        loud = size > SETTLED * self._peak
        order = np.argsort(time[loud], kind="stable")
        time, size = time[loud][order], size[loud][order]
        largest_later = np.maximum.accumulate(np.append(size[1:], -1.0)[::-1])[::-1]
        kept = size > largest_later
        self._time, self._size = time[kept], size[kept]

    def result(self) -> float:
        """Seconds from the first instant to the last loud one; 0 for no signal."""
        loud = self._time[self._size > SETTLED * self._peak]
        return float(loud[-1] - self._first) if len(loud) else 0.0


def settling_time(time: np.ndarray, signal: np.ndarray) -> float:
    """Seconds from the first instant to the last one at which |signal| (N,) exceeds `SETTLED` of its peak."""
    settling = Settling()
    settling.add(time, signal)
    return settling.result()
