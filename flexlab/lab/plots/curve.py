"""Signals over a moving window, thinned for plotting: every point drawn is a sample, at its own time, and no peak is lost.

A 44 Hz ring drawn through every twentieth sample becomes a slow wave that never was; its extremes drawn at fixed places make
staircases of every smooth signal. So each stretch of time gives the samples where a signal is least and greatest: a ring
stays as wide as it is, a slow signal a smooth line. Stretches lie on multiples of their length: nothing shimmers while the
window moves on. Where a browser has zoomed in, stretches are shorter.
"""

from collections.abc import Sequence

import numpy as np

from flexlab.sim.snapshot import TICK

STRETCHES = 140
"""Per window, or per part of it that is zoomed into: one per two screen pixels of a plot."""
WHOLE = (0.0, 1.0)
"""What is seen of a window where nobody has zoomed in, as shares of it."""


class Curve:
    """The newest samples of `signals` signals: a window of `seconds` s. They come in time order through `append`.

    `keep_all`: forget nothing that leaves the window.
    """

    def __init__(self, signals: int, seconds: float, keep_all: bool = False):
        self._signals, self._keep_all = signals, keep_all
        self.stretch = max(1, round(seconds / TICK / STRETCHES))
        """Ticks of one stretch."""
        self.window = self.stretch * STRETCHES + 1
        """Ticks of the window, both ends included."""
        self.clear()

    def clear(self) -> None:
        """Forget all samples."""
        self._values = np.empty((self._signals, 0))
        self._first = self._origin = 0
        self.newest = -1
        """Tick of the newest sample, -1 when empty."""

    def append(self, time: np.ndarray, values: np.ndarray) -> None:
        """Add samples at `time` (N,) s with `values` (signals, N); those not newer than the newest are passed over."""
        ticks = np.rint(time / TICK).astype(int)
        fresh = ticks > self.newest
        if not fresh.any():
            return
        ticks, values = ticks[fresh], values[:, fresh]
        if self.newest < 0:
            self._first = self._origin = int(ticks[0])
        end = self._first + self._values.shape[1]
        block = np.full((self._signals, int(ticks[-1]) + 1 - end), np.nan)
        block[:, ticks - end] = values
        self.newest = int(ticks[-1])
        self._values = np.concatenate([self._values, block], axis=1)
        surplus = self._values.shape[1] - 2 * self.window
        if surplus > 0 and not self._keep_all:
            self._values, self._first = self._values[:, surplus:], self._first + surplus

    @property
    def start(self) -> int:
        """First tick of the window, which stands still until it is full."""
        return self.stretch * max(self._origin // self.stretch, self.newest // self.stretch - STRETCHES + 1)

    def block(self, start: int) -> np.ndarray:
        """All samples of the window that begins at tick `start`, (signals, window); NaN where there is none."""
        found = np.full((self._signals, self.window), np.nan)
        first, last = max(start, self._first), min(start + self.window, self._first + self._values.shape[1])
        if first < last:
            found[:, first - start : last - start] = self._values[:, first - self._first : last - self._first]
        return found


def drawn_points(block: np.ndarray, seen: Sequence[float] = WHOLE) -> np.ndarray:
    """Indices (P,) of the samples of `block` (signals, N) to draw: its ends, the borders of gaps, and all signals' extremes.

    `seen`: the part of the block that is zoomed into, as shares of it.
    """
    last = block.shape[1] - 1
    drawn = np.zeros(last + 1, bool)
    drawn[[0, last]] = True
    missing = np.asarray(np.isnan(block).any(axis=0), bool)
    borders = np.flatnonzero(missing[1:] != missing[:-1])
    drawn[borders] = drawn[borders + 1] = True
    coarse = max(1, last // STRETCHES)
    low, high = (min(max(share, 0.0), 1.0) * last for share in seen)
    fine = max(1, min(coarse, round((high - low) / STRETCHES)))
    first, end = int(low) // coarse * coarse, min(-(-int(high) // coarse) * coarse, last)
    _mark_extremes(drawn[: first + 1], block[:, : first + 1], coarse)
    _mark_extremes(drawn[first : end + 1], block[:, first : end + 1], fine)
    _mark_extremes(drawn[end:], block[:, end:], coarse)
    return np.flatnonzero(drawn)


def _mark_extremes(drawn: np.ndarray, block: np.ndarray, stretch: int) -> None:
    """Mark where each signal is least and greatest within each stretch; neighbours share the sample between them."""
    count = (block.shape[1] - 1) // stretch
    if stretch == 1 or count < 1:
        drawn[:] = True
        return
    end = count * stretch
    pieces = np.lib.stride_tricks.sliding_window_view(block[:, : end + 1], stretch + 1, axis=1)[:, ::stretch]
    begin = np.arange(count) * stretch
    empty = np.isnan(pieces)
    known = ~empty.all(axis=2)
    silent = np.asarray(empty.all(axis=(0, 2)), bool)
    drawn[begin[silent]] = True  # Axes are held by points, where there is nothing to draw as well.
    for places in (np.where(empty, np.inf, pieces).argmin(axis=2), np.where(empty, -np.inf, pieces).argmax(axis=2)):
        drawn[(begin + places)[known]] = True
    if end + 1 < block.shape[1]:
        _mark_extremes(drawn[end:], block[:, end:], block.shape[1] - 1 - end)
