"""A path in one file: a spiral out of the centre, held at its end. It declares no extent: flexlab samples it."""

from typing import Literal

import numpy as np

from flexlab.compiled import pluggable
from flexlab.control.path import Path, Trajectory
from flexlab.quantities import Number, Triple, quantity


class Spiral(Trajectory):
    """A spiral of `turns` turns within `duration`."""

    kind: Literal["spiral"] = "spiral"
    center: Triple = quantity((0.0, 0.75, 0.0), title="Centre (x, y, θ)", unit="m, m, rad", low=-20, high=20)
    largest_radius: Number = quantity(0.1, title="Largest radius", symbol="R", unit="m", low=0, high=1, slider=(0, 0.2))
    turns: Number = quantity(2.0, title="Turns", symbol="N", unit="1", low=0, high=20, slider=(0, 5))
    duration: Number = quantity(1.0, title="Duration", symbol="T_m", unit="s", low=0.1, high=100, slider=(0.5, 5))

    @property
    def span(self) -> float:
        """Time after which the path ends, s."""
        return self.duration

    @property
    def end(self) -> float:
        """Time from which the path stands still, s."""
        return self.duration


@pluggable
def spiral(path, rows, t, desired):
    """center + R share (cos α, sin α) with α = 2π turns share, share = min(t / duration, 1)."""
    u, rate = min(t / path.duration, 1.0), 1 / path.duration if t < path.duration else 0.0
    turn = 2 * np.pi * path.turns
    c, s = np.cos(turn * u), np.sin(turn * u)
    R = path.largest_radius
    desired[0, 0], desired[0, 1], desired[0, 2] = path.center[0] + R * u * c, path.center[1] + R * u * s, path.center[2]
    desired[1, 0], desired[1, 1] = R * rate * (c - turn * u * s), R * rate * (s + turn * u * c)
    desired[2, 0] = R * rate * rate * (-2 * turn * s - turn * turn * u * c)
    desired[2, 1] = R * rate * rate * (2 * turn * c - turn * turn * u * s)
    desired[1, 2] = desired[2, 2] = 0.0


PATH = Path(Spiral, spiral)
