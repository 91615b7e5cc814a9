"""What each arm carries of the payload: equal shares (Eq. 25), and the payload as the controller believes it to be."""

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


@inlined
def share_payload(payload, c, s, share, A):
    """A = share · (A11 - A12 A22⁻¹ A21) at q = 0 (3, 3): the payload inertia one arm drives (Eq. 25)."""
    hh, hg, gg = payload.kappa[0], payload.kappa[1], payload.kappa[2]
    A[0, 0], A[1, 1], A[2, 2] = payload.m - s * s * hh, payload.m - c * c * hh, payload.I - gg
    A[0, 1], A[0, 2], A[1, 2] = s * c * hh, s * hg, -c * hg
    A[1, 0], A[2, 0], A[2, 1] = A[0, 1], A[0, 2], A[1, 2]
    for a in range(3):
        for b in range(3):
            A[a, b] *= share


@inlined
def drive_arms(payload, gravity, terms, acceleration, rate, feedback, A, u):
    """u_i = (M̄_i + share Ā) acceleration + C̄_i rate + Ḡ_i + share (feedback + weight), all (3,); A is scratch (3, 3)."""
    share = 1.0 / len(u)
    share_payload(payload, terms.trig[0], terms.trig[1], share, A)
    for i in range(len(u)):
        for a in range(3):
            total = terms.G[i, a] + share * feedback[a]
            for b in range(3):
                total += (terms.M[i, a, b] + A[a, b]) * acceleration[b] + terms.C[i, a, b] * rate[b]
            u[i, a] = total
        u[i, 1] += share * payload.m * gravity
