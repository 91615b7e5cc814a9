"""The one seam between the engine and the control law that is in force: its kernel and its fastest rate, by their addresses."""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import call_kernel, call_number_kernel, inlined
from flexlab.control.load_sharing import BelievedPayload


class Control(NamedTuple):
    """A control law with its gains, and how its inputs and outputs reach the plant."""

    law: int
    """Address of the law's kernel."""
    fastest_rate: int
    """Address of its fastest rate."""
    gains: np.ndarray
    """The law's record of gains, flat."""
    memory_size: int
    signal_count: int
    """Numbers in the law's own signals."""
    estimates: int
    """Where b̂ stands in the memory, negative if nowhere."""
    sliding_slope: np.ndarray
    """Λ of the sliding variable that is shown, 1/s, (3,)."""
    payload: BelievedPayload
    share: np.ndarray
    """What each arm carries of the common part, 1, (2,)."""
    internal_force: float
    """F_d, N: wanted squeeze of the payload between two arms."""
    torque_limit: np.ndarray
    """N·m per joint, infinite where there is none, (3,)."""
    limited: bool
    sampled: bool
    """Zero-order hold: the inputs are computed by `sim.sampled_control` at the control instants only."""


@inlined
def control_law(control, gravity, mass, x, v, beam_rate, desired, now, memory, memory_rate, signals):
    """Fill now.u (arms, 3), memory_rate and signals for the pose x, its rate v and hᵀq̇, gᵀq̇ in beam_rate (2,).

    `mass`: of `believed_mass`. The wanted internal force joins in what the law gives. `now`: the `LAW_INPUT` record whose arm
    terms are those of x and v.
    """
    payload = control.payload
    factor, now.growth = mass
    now.gravity, now.m, now.I = gravity, factor * payload.m, factor * payload.I
    for a in range(3):
        now.x[a], now.v[a], now.kappa[a] = x[a], v[a], factor * payload.kappa[a]
        for order in range(3):
            now.desired[order, a] = desired[order, a]
    for a in range(2):
        now.beam_rate[a], now.share[a] = beam_rate[a], control.share[a]
    for a in range(len(memory_rate)):
        memory_rate[a] = 0.0
    call_kernel(control.law, control.gains, (now, memory, memory_rate, signals))
    if control.internal_force != 0:
        for a in range(2):
            squeeze = control.internal_force * now.trig[a]
            now.u[0, a] += squeeze
            now.u[1, a] -= squeeze


@inlined
def fastest_control_rate(control, now, memory, S, kappa):
    """1/s, of the closed loop's part that the law shapes, at the instant of `now` (its x and v), memory (m,), S (3, 3)."""
    return call_number_kernel(control.fastest_rate, control.gains, (now, memory, S, kappa))
