"""The paper's path: a sine in x, y and θ (Section IV)."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

from flexlab.compiled import pluggable
from flexlab.control.path import Path, Trajectory
from flexlab.control.phase import SLOWEST, kept_phase, squared_rate, three
from flexlab.numerics.elementary import sin_cos
from flexlab.quantities import OneOrThree, Triple, quantity

POINTS_PER_PERIOD = 200
"""Instants per period of the fastest component: the path between two is under 1e-3 of the amplitude from a chord."""


class SineTrajectory(Trajectory):
    """x_d(t) = center + amplitude · sin(2π frequency t + phase), for x, y and θ (Section IV of the paper).

    Amplitude, frequency and phase may be one number for all three.
    """

    kind: Literal["sine"] = "sine"
    center: Triple = quantity((0.0, 0.75, 0.0), "Centre (x, y, θ)", "x_c", "m, m, rad", low=-100, high=100)
    amplitude: OneOrThree = quantity(
        (0.2, 0.2, 0.2), "Amplitude (x, y, θ)", "A_d", "m, m, rad", low=-5, high=5, slider=(0, 0.4)
    )
    frequency: OneOrThree = quantity((1.0, 1.0, 1.0), "Frequency", "f_d", "Hz", low=0, high=50, slider=(0.1, 3))
    phase: OneOrThree = quantity((0.0, 0.0, 0.0), "Phase", "φ_d", "rad", low=-100, high=100)

    def _moving(self) -> list[float]:
        """Frequencies that move something, Hz."""
        return [f for f, a in zip(three(self.frequency), three(self.amplitude), strict=True) if a != 0 and f > SLOWEST]

    @property
    def span(self) -> float:
        """One period, or ten of the slowest component if the frequencies differ, s; 0 for a path at rest."""
        moving = self._moving()
        return 1 / min(moving) * (1 if len(set(moving)) == 1 else 10) if moving else 0.0

    @property
    def shortest_time(self) -> float:
        """Time between two checked instants, s."""
        return 1 / (POINTS_PER_PERIOD * max(self._moving(), default=1.0))

    @property
    def fastest_period(self) -> float:
        """Period of the fastest component, s."""
        return 1 / max(*three(self.frequency), 1e-3)

    @property
    def slowest_period(self) -> float:
        """Period of the slowest component, s; 1 for a path at rest."""
        return 1 / min(self._moving(), default=1.0)

    @property
    def middle(self) -> tuple[float, ...]:
        """Its centre."""
        return self.center

    @property
    def reach(self) -> tuple[float, ...]:
        """Its amplitudes."""
        return tuple(abs(a) for a in three(self.amplitude))

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """A (2πf)²."""
        both = zip(three(self.amplitude), three(self.frequency), strict=True)
        return tuple(abs(a) * squared_rate(f) for a, f in both)

    def keeping(self, changed: Trajectory, changes: Mapping[str, Any], time: float) -> Trajectory:
        """A new frequency keeps the sine's argument, so that the target does not jump."""
        if (
            not isinstance(changed, SineTrajectory)
            or three(self.frequency) == three(changed.frequency)
            or "phase" in changes
        ):
            return changed
        parts = zip(three(self.phase), three(self.frequency), three(changed.frequency), strict=True)
        phase = tuple(kept_phase(p, f0, f1, time) for p, f0, f1 in parts)
        same = len(set(phase)) == 1 and not isinstance(changed.phase, tuple)
        return changed.model_copy(update={"phase": phase[0] if same else phase})


@pluggable
def sine(path, rows, t, desired):
    """x_d = center + amplitude sin(2π frequency t + phase)."""
    sine = cosine = 0.0
    for a in range(3):
        rate = 2 * np.pi * path.frequency[a]
        # Usually x, y and θ move alike; a sine costs as much as an arm's mass matrix.
        if a == 0 or path.frequency[a] != path.frequency[0] or path.phase[a] != path.phase[0]:
            angle = rate * t + path.phase[a]
            own_sine, own_cosine = sin_cos(angle)
            if a == 0:
                sine, cosine = own_sine, own_cosine
        else:
            own_sine, own_cosine = sine, cosine
        amplitude = path.amplitude[a]
        desired[0, a] = path.center[a] + amplitude * own_sine
        desired[1, a] = amplitude * rate * own_cosine
        desired[2, a] = -amplitude * rate * rate * own_sine


PATH = Path(SineTrajectory, sine, place=10)
