"""Signals thinned for plotting without losing a peak: the least and the greatest value of every short stretch of time.

A 44 Hz ring drawn through every twentieth sample becomes a slow wave that never was. Drawn from minimum to maximum of each
stretch it becomes a band as wide as the ring. Stretches lie on multiples of their length, so they do not change, and
nothing shimmers, while the window moves on.
"""

import numpy as np

from flexlab.sim.snapshot import TICK

BINS = 140
"""Stretches per window: one per two screen pixels of a plot."""


class Envelope:
    """Minimum and maximum of `signals` signals over a moving window of `seconds` s.

    Samples come in time order through `append`. `keep_all`: forget nothing that leaves the window.
    """

    def __init__(self, signals: int, seconds: float, keep_all: bool = False):
        self._kept_bins = 10**9 if keep_all else BINS
        self._ticks = max(1, round(seconds / TICK / BINS))
        self.bin_width = self._ticks * TICK
        """Length of one stretch, s."""
        self._signals = signals
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._first_bin = 0
        self._low = np.empty((self._signals, 0))
        self._high = np.empty((self._signals, 0))
        self._first = np.empty((self._signals, 0))
        self._last = np.empty((self._signals, 0))
        self.newest = -1
        """Tick of the newest sample, -1 when empty."""

    def append(self, time: np.ndarray, values: np.ndarray) -> None:
        """Add samples at `time` (N,) s with `values` (signals, N); those not newer than the newest are passed over."""
        ticks = np.rint(time / TICK).astype(int)
        fresh = ticks > self.newest
        if not fresh.any():
            return
        ticks, values = ticks[fresh], values[:, fresh]
        bins = ticks // self._ticks
        starts = np.flatnonzero(np.diff(bins, prepend=bins[0] - 1))
        low = np.fmin.reduceat(values, starts, axis=1)
        high = np.fmax.reduceat(values, starts, axis=1)
        ends = np.append(starts[1:], len(bins)) - 1
        self._merge(bins[starts], low, high, values[:, starts], values[:, ends])
        self.newest = int(ticks[-1])

    def _merge(self, bins: np.ndarray, low: np.ndarray, high: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> None:
        """Add stretches (bins,) with their extremes, first and last values (signals, bins each)."""
        if self.newest < 0:
            self._first_bin = int(bins[0])
        last = int(bins[-1])
        first = max(self._first_bin, last - self._kept_bins)
        kept = slice(first - self._first_bin, None)
        missing = last - self._first_bin + 1 - self._low.shape[1]
        gap = np.full((self._signals, max(missing, 0)), np.nan)
        self._low = np.concatenate([self._low, gap], axis=1)[:, kept]
        self._high = np.concatenate([self._high, gap], axis=1)[:, kept]
        self._first = np.concatenate([self._first, gap], axis=1)[:, kept]
        self._last = np.concatenate([self._last, gap], axis=1)[:, kept]
        self._first_bin = first
        seen = bins >= first
        at = bins[seen] - first
        self._low[:, at] = np.fmin(self._low[:, at], low[:, seen])
        self._high[:, at] = np.fmax(self._high[:, at], high[:, seen])
        # A stretch may come in several pieces: whether it falls is seen from its first piece to its last.
        self._first[:, at] = np.where(np.isnan(self._first[:, at]), starts[:, seen], self._first[:, at])
        self._last[:, at] = ends[:, seen]

    @property
    def start(self) -> int:
        """Number of the first stretch of the window; stretch k covers k · bin_width to (k + 1) · bin_width."""
        return max(self._first_bin, self._first_bin + self._low.shape[1] - BINS)

    def lines(self, start: int | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Time (P,) s and zigzag lines (signals, P): each stretch gives its two extremes, NaN where it is empty.

        The extremes stand in the order in which a slow signal passes them, so that it stays a smooth line. The times always
        span the same window length, so that the plot's axis moves on evenly from the first sample. `start`: the window's
        first stretch, by default that of the newest window.
        """
        first = self.start if start is None else start
        source = np.arange(first, first + BINS) - self._first_bin
        filled = (source >= 0) & (source < self._low.shape[1])
        low, high = np.full((2, self._signals, BINS), np.nan)
        low[:, filled], high[:, filled] = self._low[:, source[filled]], self._high[:, source[filled]]
        if self._ticks == 1:
            return (first + np.arange(BINS)) * self.bin_width, low
        falling = np.zeros((self._signals, BINS), bool)
        falling[:, filled] = self._last[:, source[filled]] < self._first[:, source[filled]]
        time = (first + (np.arange(2 * BINS) * 0.5 + 0.25)) * self.bin_width
        pairs = np.stack([np.where(falling, high, low), np.where(falling, low, high)], axis=2)
        return time, pairs.reshape(self._signals, 2 * BINS)

    def extent(self) -> np.ndarray:
        """The greatest absolute value of each signal in the window, (signals,), 0 where there is none."""
        if not self._low.shape[1]:
            return np.zeros(self._signals)
        both = np.fmax(np.abs(self._low), np.abs(self._high))
        return np.nan_to_num(np.fmax.reduce(both, axis=1))
