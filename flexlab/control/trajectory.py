"""Desired motion of the payload (Section IV of the paper)."""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import inlined


class Sine(NamedTuple):
    """x_d = center + amplitude sin(2π frequency t + phase), each (3,) for x, y, θ; frequency in Hz."""

    center: np.ndarray
    amplitude: np.ndarray
    frequency: np.ndarray
    phase: np.ndarray


@inlined
def desired_motion(trajectory, t, desired):
    """Fill x_d, ẋ_d, ẍ_d (3, 3) at time t, s."""
    sine = cosine = 0.0
    for a in range(3):
        rate = 2 * np.pi * trajectory.frequency[a]
        # Equal motions in x, y and θ are the common case; a sine costs as much as an arm's mass matrix.
        if a == 0 or trajectory.frequency[a] != trajectory.frequency[0] or trajectory.phase[a] != trajectory.phase[0]:
            angle = rate * t + trajectory.phase[a]
            own_sine, own_cosine = np.sin(angle), np.cos(angle)
            if a == 0:
                sine, cosine = own_sine, own_cosine
        else:
            own_sine, own_cosine = sine, cosine
        amplitude = trajectory.amplitude[a]
        desired[0, a] = trajectory.center[a] + amplitude * own_sine
        desired[1, a] = amplitude * rate * own_cosine
        desired[2, a] = -amplitude * rate * rate * own_sine
