"""Computed torque: the rigid system's inverse dynamics with linear pose feedback."""

from typing import Literal

import numpy as np

from flexlab.compiled import pluggable
from flexlab.control.controller import Controller
from flexlab.control.law import Law
from flexlab.control.law_kernels import drive_arms
from flexlab.quantities import OneOrThree, quantity


class ComputedTorque(Controller):
    """Inverse dynamics of the rigid system with pose feedback: ẍ → ẍ_d - K_d ė - K_p e."""

    kind: Literal["computed-torque"] = "computed-torque"
    position_gain: OneOrThree = quantity(2500.0, "Position gain", "K_p", "1/s²", low=0, high=1e7, slider=(0, 10000))
    velocity_gain: OneOrThree = quantity(100.0, "Velocity gain", "K_d", "1/s", low=0, high=1e5, slider=(0, 500))


@pluggable
def computed_torque(gains, now, memory, memory_rate, signals):
    """u_i = (M̄_i + share Ā) a + C̄_i ẋ + Ḡ_i + share weight with a = ẍ_d - K_d ė - K_p e."""
    x, v, desired = now.x, now.v, now.desired
    acceleration, nothing, A = now.scratch[0], now.scratch[2], now.scratch[3:6]
    for a in range(3):
        nothing[a] = 0.0
        rate_error, error = v[a] - desired[1, a], x[a] - desired[0, a]
        acceleration[a] = desired[2, a] - gains.velocity_gain[a] * rate_error - gains.position_gain[a] * error
    drive_arms(now, acceleration, v, nothing, A)


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """Fastest rate, 1/s: K_d, as the inertia is cancelled."""
    return max(gains.velocity_gain)


def gain_ratio(law) -> np.ndarray:
    """Position over velocity gain, 1/s, (3,): the Λ with which s is plotted for laws without a sliding surface."""
    position, velocity = (np.broadcast_to(np.array(gain, float), 3) for gain in (law.position_gain, law.velocity_gain))
    slope = np.zeros(3)
    np.divide(position, velocity, out=slope, where=velocity > 0)
    return slope


LAW = Law(ComputedTorque, computed_torque, fastest_rate, sliding_slope=gain_ratio, relies_on_masses=True, place=30)
