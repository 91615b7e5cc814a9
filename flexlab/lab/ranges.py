"""A plot's vertical range: it grows at once, shrinks late, and only in steps, so that it hardly ever jumps."""

import math

STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Ends of axes, times a power of ten."""
SHRINK_BELOW = 0.45
"""The range shrinks when the signals use less than this share of it ..."""
SHRINK_AFTER = 15
"""... for this many updates in a row (1.5 s at 10 Hz)."""
HARDLY_SEEN, NARROWEST = 0.005, 0.1
"""Shares of a plot's larger side: below the first the other side is left out, above it it gets at least the second."""


class Range:
    """The range -limit..limit of one plot; `fit` follows the signals. `least`: the smallest limit, in plot units.

    `patience`: updates in a row that must find the range too wide before it shrinks.
    """

    def __init__(self, least: float, patience: int = SHRINK_AFTER):
        self._least, self._patience = least, patience
        self.limit = least
        self._small_for = 0

    def fit(self, extent: float) -> None:
        """Take in the greatest absolute value now in the window."""
        wanted = max(round_up(extent * 1.05), self._least)
        self._small_for = self._small_for + 1 if extent < SHRINK_BELOW * self.limit and wanted < self.limit else 0
        if wanted > self.limit or self._small_for >= self._patience:
            self.limit, self._small_for = wanted, 0


class Span:
    """The range low..high of one plot, about 0: each side as far as its signals go, none where they never go there."""

    def __init__(self, least: float):
        """`least`: what each side shows before the first signal, and the larger one at least, in plot units."""
        self._least = least
        self._sides = Range(0.0), Range(0.0)

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end."""
        low, high = (side.limit for side in self._sides)
        larger = max(low, high)
        if larger == 0:
            return -self._least, self._least
        # What is hardly to be seen beside the other side needs no room of its own.
        low, high = (0.0 if side < HARDLY_SEEN * larger else max(side, NARROWEST * larger) for side in (low, high))
        return -low if low == 0 else -max(low, self._least), high if high == 0 else max(high, self._least)

    def fit(self, low: float, high: float) -> None:
        """Take in the least and the greatest value now in the window."""
        for side, extent in zip(self._sides, (-low, high), strict=True):
            side.fit(max(extent, 0.0))


def round_up(value: float) -> float:
    """The least of `STEPS` times a power of ten that is not below `value`; 0 for what is not a positive number."""
    if not value > 0 or not math.isfinite(value):
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    return power * next((step for step in STEPS if value <= step * power * (1 + 1e-9)), 10.0)
