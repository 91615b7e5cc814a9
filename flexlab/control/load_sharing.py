"""What each arm carries of the payload, as the controller believes it to be: its share (half in Eq. 25), and of its bending.

With q̈ from the beam's own equation the pose feels (A11 - A12A22⁻¹A21)ẍ - A12A22⁻¹(K_F q + Dq̇) = u. The laws drive the first
term; the second is the force of the bent beam. Bent as the desired motion bends it at rest, K_F q = -A21 ẍ_d, it is
A12A22⁻¹A21 ẍ_d at q = 0: most of what a pinned beam's mass asks for laterally, and what otherwise the feedback must find.
(The weight that bends the beam cancels: the grips carry all of it.)
"""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import inlined


class BelievedPayload(NamedTuple):
    """The controller's payload; κ over all modes, whatever the plant keeps."""

    m: float
    """kg."""
    I: float  # noqa: E741
    """kg·m²."""
    kappa: np.ndarray
    """hᵀM_q⁻¹h, hᵀM_q⁻¹g, gᵀM_q⁻¹g, (3,)."""
    change: float
    """Part of the change of its mass that the controller knows of, 1."""


@inlined
def share_payload(now, share, A):
    """A = share · (A11 - A12 A22⁻¹ A21) at q = 0 (3, 3): the payload inertia one arm drives (Eq. 25)."""
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
    """Add `share` of A12A22⁻¹A21 ẍ_d to now.u, shared as the law shares the common part.

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
