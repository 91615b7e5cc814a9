"""A plot's vertical range: it grows at once, shrinks late and changes only in steps, so that it rarely jumps."""

import math

STEPS = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Limits of axes, times a power of ten."""
SHRINK_BELOW = 0.45
"""The range shrinks when the signals use less than this fraction of it ..."""
SHRINK_AFTER = 15
"""... for this many updates in a row (1.5 s at 10 Hz)."""
AFTER_PICTURES = 75
"""The same for what is drawn in every picture (2.5 s)."""
HARDLY_SEEN, NARROWEST = 0.005, 0.1
"""Fractions of a plot's larger side: the other side is left out below the first, and otherwise has at least the second."""


class Range:
    """The range -limit..limit of one plot, which `fit` adapts to the signals. `least`: the smallest limit, in plot units.

    `patience`: consecutive updates that must find the range too wide before it shrinks.
    """

    def __init__(self, least: float, patience: int = SHRINK_AFTER):
        self._least, self._patience = least, patience
        self.limit = least
        self._small_for = 0

    def fit(self, extent: float) -> None:
        """Adapt to the largest absolute value now in the window."""
        wanted = max(round_up(extent * 1.05), self._least)
        self._small_for = self._small_for + 1 if extent < SHRINK_BELOW * self.limit else 0
        if wanted > self.limit or self._small_for >= self._patience:
            self.limit, self._small_for = wanted, 0


class Span:
    """The range low..high of one plot around 0: each side extends as far as the signals; a side that they never reach is 0."""

    def __init__(self, least: float):
        """`least`: limit of both sides before the first signal, and then the least of a side in use, in plot units."""
        self._least = least
        self._sides = Range(0.0), Range(0.0)

    @property
    def ends(self) -> tuple[float, float]:
        """Lower and upper end."""
        low, high = (side.limit for side in self._sides)
        larger = max(low, high)
        if larger == 0:
            return -self._least, self._least
        # A side that is hardly visible beside the other one needs no room.
        low, high = (0.0 if side < HARDLY_SEEN * larger else max(side, NARROWEST * larger) for side in (low, high))
        return -low if low == 0 else -max(low, self._least), high if high == 0 else max(high, self._least)

    def fit(self, low: float, high: float) -> None:
        """Adapt to the least and the greatest value now in the window."""
        for side, extent in zip(self._sides, (-low, high), strict=True):
            side.fit(max(extent, 0.0))


def round_up(value: float) -> float:
    """The least of `STEPS` times a power of ten that is not below `value`; 0 if `value` is not positive and finite."""
    if not value > 0 or not math.isfinite(value):
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    return power * next((step for step in STEPS if value <= step * power * (1 + 1e-9)), 10.0)
