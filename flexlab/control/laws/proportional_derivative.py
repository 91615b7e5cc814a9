"""Task-space PD with weight compensation: a law that needs no model of the dynamics."""

from typing import Literal

import numpy as np

from flexlab.compiled import pluggable
from flexlab.control.controller import Controller
from flexlab.control.law import Law
from flexlab.control.laws.computed_torque import gain_ratio
from flexlab.control.rates import largest_ratio
from flexlab.quantities import OneOrThree, quantity


class ProportionalDerivative(Controller):
    """Task-space PD with weight compensation and nothing else known: u = Ḡ - P e - D ė."""

    kind: Literal["pd"] = "pd"
    position_gain: OneOrThree = quantity(
        20000.0, "Position gain", "P", "N/m, N·m/rad", low=0, high=1e8, slider=(0, 100000)
    )
    velocity_gain: OneOrThree = quantity(
        800.0, "Velocity gain", "D", "N·s/m, N·m·s/rad", low=0, high=1e6, slider=(0, 5000)
    )


@pluggable
def proportional_derivative(gains, now, memory, memory_rate, signals):
    """u_i = Ḡ_i + share (weight - P e - D ė), (arms, 3)."""
    x, v, desired = now.x, now.v, now.desired
    for i in range(now.arm_count):
        for a in range(3):
            feedback = gains.position_gain[a] * (x[a] - desired[0, a]) + gains.velocity_gain[a] * (v[a] - desired[1, a])
            now.u[i, a] = now.G[i, a] - now.share[i] * feedback
        now.u[i, 1] += now.share[i] * now.m * now.gravity


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """Fastest rate, 1/s: that of the damping, S⁻¹D, plus that of the stiffness, √(S⁻¹P)."""
    scratch = now.scratch[3:6]
    return largest_ratio(S, gains.velocity_gain, scratch) + np.sqrt(largest_ratio(S, gains.position_gain, scratch))


LAW = Law(ProportionalDerivative, proportional_derivative, fastest_rate, sliding_slope=gain_ratio, place=40)
