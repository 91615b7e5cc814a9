"""How long the window is that the other metrics speak of."""

from typing import TYPE_CHECKING, Self

import numpy as np

from flexlab.analysis.metrics.metric import Column, Metric, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


@register
class Duration(Metric):
    """From the first sample to the last, s; 0 without samples."""

    name, place = "duration", 0
    columns = (Column("window", "Duration", "duration", "s"),)

    def __init__(self) -> None:
        self._first, self._last = np.inf, -np.inf

    def update(self, samples: "Samples") -> None:
        """Take in a piece of a run."""
        self._first = min(self._first, float(samples.time[0]))
        self._last = max(self._last, float(samples.time[-1]))

    def merge(self, other: Self) -> None:
        """Take in what another one has taken in."""
        self._first, self._last = min(self._first, other._first), max(self._last, other._last)

    def compute(self) -> tuple[float, ...]:
        """Seconds."""
        return (self._last - self._first if self._last >= self._first else 0.0,)
