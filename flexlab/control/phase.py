"""What periodic paths share: one number or three, and a phase that is kept when the frequency changes."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from flexlab.control.path import Trajectory

SLOWEST = 1e-9
"""Frequency, Hz, up to which a path counts as at rest: a round takes over thirty years, and the period might overflow."""


def three(value: float | tuple[float, ...]) -> tuple[float, ...]:
    """Three values; a single one is repeated."""
    return value if isinstance(value, tuple) else (value,) * 3


def squared_rate(frequency: float) -> float:
    """(2πf)², 1/s²."""
    return (2 * np.pi * frequency) * (2 * np.pi * frequency)


def kept_phase(phase: float, old: float, new: float, time: float) -> float:
    """The phase, rad, with which the angle at `time`, s, is the same at a new frequency, Hz, as at the old one."""
    if old == new:
        return phase
    return float(np.remainder(phase + 2 * np.pi * (old - new) * time, 2 * np.pi))


class RoundPath(Trajectory):
    """A closed path round its `center` at one frequency; subclasses declare these fields."""

    if TYPE_CHECKING:
        center: tuple[float, ...]
        frequency: float
        phase: float

    points_per_round: ClassVar[int]
    """Points per round at which the path deviates from a chord by less than 1e-3 of its size."""

    @property
    def span(self) -> float:
        """Time of one round, s; 0 if the path rests."""
        return 1 / self.frequency if self.frequency > SLOWEST and any(self.reach) else 0.0

    @property
    def shortest_time(self) -> float:
        """Time between two points, s."""
        return (self.span or 1.0) / self.points_per_round

    @property
    def middle(self) -> tuple[float, ...]:
        """Its centre."""
        return self.center

    def keeping(self, changed: Trajectory, changes: Mapping[str, Any], time: float) -> Trajectory:
        """`changed`, with the phase that keeps the present angle at a new frequency."""
        if not isinstance(changed, type(self)) or "phase" in changes:
            return changed
        return changed.model_copy(update={"phase": kept_phase(self.phase, self.frequency, changed.frequency, time)})
