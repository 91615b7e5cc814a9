"""What periodic paths share: one number or three, and phases that live changes of a frequency keep."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from flexlab.control.path import Trajectory

SLOWEST = 1e-9
"""Hz: at or below it a path counts as at rest, as a round takes over thirty years; its period may not even be a number."""


def three(value: float | tuple[float, ...]) -> tuple[float, ...]:
    """One number as the three that it stands for."""
    return value if isinstance(value, tuple) else (value,) * 3


def squared_rate(frequency: float) -> float:
    """(2πf)², 1/s²."""
    return (2 * np.pi * frequency) * (2 * np.pi * frequency)


def kept_phase(phase: float, old: float, new: float, time: float) -> float:
    """The phase, rad, with which a new frequency, Hz, has at `time`, s, the angle that the old one had."""
    if old == new:
        return phase
    return float(np.remainder(phase + 2 * np.pi * (old - new) * time, 2 * np.pi))


class RoundPath(Trajectory):
    """A path that goes round its `center` again and again, at one frequency: its subclass declares these fields."""

    if TYPE_CHECKING:
        center: tuple[float, ...]
        frequency: float
        phase: float

    points_per_round: ClassVar[int]
    """So many that the path between two is under 1e-3 of its size from a chord."""

    @property
    def span(self) -> float:
        """A round, s."""
        return 1 / self.frequency if self.frequency > SLOWEST and any(self.reach) else 0.0

    @property
    def shortest_time(self) -> float:
        """Between two points, s."""
        return (self.span or 1.0) / self.points_per_round

    @property
    def middle(self) -> tuple[float, ...]:
        """Its centre."""
        return self.center

    def keeping(self, changed: Trajectory, changes: Mapping[str, Any], time: float) -> Trajectory:
        """A new frequency alone keeps the angle."""
        if not isinstance(changed, type(self)) or "phase" in changes:
            return changed
        return changed.model_copy(update={"phase": kept_phase(self.phase, self.frequency, changed.frequency, time)})
