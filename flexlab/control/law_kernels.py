"""How the engine calls the control law in force, and how laws share what drives the payload between the arms.

With q̈ from the beam's own equation, Eq. (18), the pose feels (A11 - A12A22⁻¹A21)ẍ - A12A22⁻¹(K_F q + Dq̇) = u (Eq. (19)). The
laws drive the first term, each arm its share of it (half in Eq. (25)). The second is the force of the bent beam. If the desired
motion bends it quasi-statically, K_F q = -A21 ẍ_d, that force is A12A22⁻¹A21 ẍ_d at q = 0: most of the lateral force that the
mass of a pinned beam needs, which feedback has to find unless it is fed forward. (The weight that bends the beam cancels: the
grips carry all of it.)
"""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import call_kernel, call_number_kernel, inlined


class BelievedPayload(NamedTuple):
    """The payload that the controller believes in; κ over all modes, however few the plant keeps."""

    m: float
    """Mass, kg."""
    I: float  # noqa: E741
    """Inertia, kg·m²."""
    kappa: np.ndarray
    """hᵀM_q⁻¹h, hᵀM_q⁻¹g, gᵀM_q⁻¹g, (3,)."""
    change: float
    """Share of the change of its mass that the controller knows, 1."""


@inlined
def share_payload(now, share, A):
    """A = share · (A11 - A12 A22⁻¹ A21) at q = 0 (3, 3): the payload inertia one arm drives (Eq. (25))."""
    c, s = now.trig[0], now.trig[1]
    hh, hg, gg = now.kappa[0], now.kappa[1], now.kappa[2]
    A[0, 0], A[1, 1], A[2, 2] = now.m - s * s * hh, now.m - c * c * hh, now.I - gg
    A[0, 1], A[0, 2], A[1, 2] = s * c * hh, s * hg, -c * hg
    A[1, 0], A[2, 0], A[2, 1] = A[0, 1], A[0, 2], A[1, 2]
    for a in range(3):
        for b in range(3):
            A[a, b] *= share


@inlined
def drive_arms(now, acceleration, rate, feedback, A):
    """u_i = (M̄_i + share Ā) acceleration + C̄_i rate + Ḡ_i + share (feedback + weight), all (3,); A is scratch (3, 3)."""
    for i in range(now.arm_count):
        share = now.share[i]
        share_payload(now, share, A)
        for a in range(3):
            total = now.G[i, a] + share * feedback[a]
            for b in range(3):
                total += (now.M[i, a, b] + A[a, b]) * acceleration[b] + now.C[i, a, b] * rate[b]
            now.u[i, a] = total
        now.u[i, 1] += share * now.m * now.gravity


@inlined
def feed_forward_bending(share, now):
    """Add `share` of A12A22⁻¹A21 ẍ_d to now.u, divided between the arms as the law divides the common part.

    In the beam's frame: κ (a_lat, α), a_lat = e2·ẍ_d along e2, α = θ̈_d.
    """
    c, s = now.trig[0], now.trig[1]
    lateral, turn = c * now.desired[2, 1] - s * now.desired[2, 0], now.desired[2, 2]
    force = share * (now.kappa[0] * lateral + now.kappa[1] * turn)
    moment = share * (now.kappa[1] * lateral + now.kappa[2] * turn)
    for i in range(now.arm_count):
        now.u[i, 0] -= now.share[i] * s * force
        now.u[i, 1] += now.share[i] * c * force
        now.u[i, 2] += now.share[i] * moment


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
    """Number of values in the law's own signals."""
    estimates: int
    """Index of b̂ in the memory; negative: it has none."""
    sliding_slope: np.ndarray
    """Λ of the sliding variable that is shown, 1/s, (3,)."""
    payload: BelievedPayload
    share: np.ndarray
    """Each arm's share of the common part, 1, (2,)."""
    internal_force: float
    """F_d, N: wanted squeeze of the payload between two arms."""
    drives: bool
    """Whether the motors work at all: if not, nothing is added to the law's answer."""
    torque_limit: np.ndarray
    """N·m per joint, infinite where there is none, (3,)."""
    limited: bool
    sampled: bool
    """Whether `sim.sampled_control` computes the torques at control instants only, with zero-order hold."""


@inlined
def control_law(control, gravity, mass, x, v, beam_rate, desired, now, memory, memory_rate, signals):
    """Fill now.u (arms, 3), memory_rate and signals for the pose x, its rate v and hᵀq̇, gᵀq̇ in beam_rate (2,).

    `mass`: from `believed_mass`. The wanted internal force is added to the law's answer. `now`: the `LAW_INPUT` record with the
    arm terms of x and v.
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
    """Fastest rate of the closed loop that the law states for `now`, its memory (m,) and S (3, 3), 1/s."""
    return call_number_kernel(control.fastest_rate, control.gains, (now, memory, S, kappa))
