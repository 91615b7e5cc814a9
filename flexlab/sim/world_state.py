"""What a run can be gone on from: everything of a world that changes with time."""

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class WorldState:
    """Everything that changes with time, copied: enough to continue a run bit for bit in the same scenario."""

    tick: int
    y: np.ndarray
    """State of `physics.plant`."""
    held_torque: np.ndarray
    """(arms, 3), N·m."""
    torque_line: np.ndarray
    """(delay + 1, arms, 3), N·m."""
    pull: np.ndarray
    """A `physics.plant.Hand`, (6,)."""


@dataclass(frozen=True)
class Origin:
    """The instant of an earlier run that a run goes on from."""

    run: str
    """The earlier run's name: that of its file."""
    time: float
    """Simulation time, s."""
    state: WorldState = field(compare=False)
    """As it was then."""
