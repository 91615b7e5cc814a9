"""A circle, with the beam's angle held."""

from typing import ClassVar, Literal

import numpy as np

from flexlab.compiled import pluggable
from flexlab.control.path import Path
from flexlab.control.phase import RoundPath, squared_rate
from flexlab.numerics.elementary import sin_cos
from flexlab.quantities import Number, Triple, quantity


class Circle(RoundPath):
    """x_d = center + radius (cos α, sin α, 0), α = 2π frequency t + phase: counter-clockwise, at constant speed."""

    kind: Literal["circle"] = "circle"
    center: Triple = quantity((0.0, 0.75, 0.0), "Centre (x, y, θ)", "x_c", "m, m, rad", low=-100, high=100)
    radius: Number = quantity(0.1, "Radius", "R", "m", low=0, high=5, slider=(0, 0.4))
    frequency: Number = quantity(1.0, "Turns per second", "f_d", "Hz", low=0, high=50, slider=(0.1, 3))
    phase: Number = quantity(0.0, "Phase", "φ_d", "rad", low=-100, high=100)
    points_per_round: ClassVar[int] = 200

    @property
    def reach(self) -> tuple[float, ...]:
        """Its radius."""
        return self.radius, self.radius, 0.0

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """R (2πf)²."""
        peak = self.radius * squared_rate(self.frequency)
        return peak, peak, 0.0


@pluggable
def circle(path, rows, t, desired):
    """The point at the angle, and its two derivatives."""
    rate = 2 * np.pi * path.frequency
    angle = rate * t + path.phase
    sine, cosine = sin_cos(angle)
    x, y = path.radius * cosine, path.radius * sine
    desired[0, 0], desired[0, 1], desired[0, 2] = path.center[0] + x, path.center[1] + y, path.center[2]
    desired[1, 0], desired[1, 1], desired[1, 2] = -rate * y, rate * x, 0.0
    desired[2, 0], desired[2, 1], desired[2, 2] = -rate * rate * x, -rate * rate * y, 0.0


PATH = Path(Circle, circle, place=40)
