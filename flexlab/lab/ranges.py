"""A plot's vertical range: it grows at once, shrinks late, and only in steps of 1, 2, 5, so that it hardly ever jumps."""

import math

SHRINK_BELOW = 0.35
"""The range shrinks when the signals use less than this share of it ..."""
SHRINK_AFTER = 15
"""... for this many updates in a row (1.5 s at 10 Hz)."""


class Range:
    """The range -limit..limit of one plot; `fit` follows the signals. `least`: the smallest limit, in plot units.

    `patience`: updates in a row that must find the range too wide before it shrinks.
    """

    def __init__(self, least: float, patience: int = SHRINK_AFTER):
        self._least, self._patience = least, patience
        self.limit = least
        self._small_for = 0

    def fit(self, extent: float) -> bool:
        """Take in the greatest absolute value now in the window; returns whether the limit changed."""
        wanted = max(round_up(extent * 1.05), self._least)
        if wanted > self.limit:
            self.limit, self._small_for = wanted, 0
            return True
        self._small_for = self._small_for + 1 if extent < SHRINK_BELOW * self.limit and wanted < self.limit else 0
        if self._small_for < self._patience:
            return False
        self.limit, self._small_for = wanted, 0
        return True


def round_up(value: float) -> float:
    """The least of 1, 2, 5 times a power of ten that is not below `value`; 0 for what is not a positive number."""
    if not value > 0 or not math.isfinite(value):
        return 0.0
    power = 10.0 ** math.floor(math.log10(value))
    for step in (1.0, 2.0, 5.0):
        if value <= step * power * (1 + 1e-9):
            return step * power
    return 10.0 * power
