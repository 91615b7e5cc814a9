"""A figure of eight on its side, with the beam turning as it goes."""

from typing import ClassVar, Literal

import numpy as np

from flexlab.compiled import pluggable
from flexlab.control.path import Path
from flexlab.control.phase import RoundPath, squared_rate
from flexlab.numerics.elementary import sin_cos
from flexlab.quantities import Number, Triple, quantity


class FigureEight(RoundPath):
    """x_d = center + (A_x sin α, A_y sin 2α, A_θ sin α), α = 2π frequency t + phase."""

    kind: Literal["figure-eight"] = "figure-eight"
    center: Triple = quantity((0.0, 0.75, 0.0), "Centre (x, y, θ)", "x_c", "m, m, rad", low=-100, high=100)
    amplitude: Triple = quantity(
        (0.15, 0.1, 0.0), "Amplitude (x, y, θ)", "A_d", "m, m, rad", low=-5, high=5, slider=(0, 0.4)
    )
    frequency: Number = quantity(0.5, "Rounds per second", "f_d", "Hz", low=0, high=50, slider=(0.1, 3))
    phase: Number = quantity(0.0, "Phase", "φ_d", "rad", low=-100, high=100)
    points_per_round: ClassVar[int] = 400
    """y goes to and fro twice in a round."""

    @property
    def reach(self) -> tuple[float, ...]:
        """Its amplitudes."""
        return tuple(abs(a) for a in self.amplitude)

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """A (2πf)², four times that in y."""
        peak = squared_rate(self.frequency)
        return tuple(abs(a) * peak * factor for a, factor in zip(self.amplitude, (1, 4, 1), strict=True))


@pluggable
def figure_eight(path, rows, t, desired):
    """Sines of the angle and of twice the angle."""
    rate = 2 * np.pi * path.frequency
    angle = rate * t + path.phase
    for a in range(3):
        times = 2.0 if a == 1 else 1.0
        (sine, cosine), own = sin_cos(times * angle), times * rate
        desired[0, a] = path.center[a] + path.amplitude[a] * sine
        desired[1, a] = path.amplitude[a] * own * cosine
        desired[2, a] = -path.amplitude[a] * own * own * sine


PATH = Path(FigureEight, figure_eight, place=50)
