"""What another engine returns."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Motion:
    """A simulated motion at the ticks after t = 0, and what it cost."""

    pose: np.ndarray
    """x0, y0, θ, m, m, rad, (N, 3)."""
    deflection: np.ndarray
    """w(0, t), m, (N,)."""
    cpu: float
    """Processor time of the simulation, s; set-up and compiling not counted."""
