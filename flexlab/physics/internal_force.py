"""The internal force, with which the arms press on the payload beyond moving it, by two routes: Eqs. (13) to (15), and Eq. (26).

All arms together move the payload with f = Σ J_iᵀf_i (Eq. (7)).
"""

import numpy as np

from flexlab.compiled import disjoint, inlined
from flexlab.physics.beam import BeamMatrices


@disjoint
def grip_force(terms, i, u, hand, x_ddot, v, force):
    """force (3,) = J_iᵀf_i = u_i - M̄_iẍ - C̄_iẋ - Ḡ_i of arm i (Eq. (13)).

    The internal force is its part beyond an equal share of the sum over all arms (Eqs. (14), (15)). `hand` (arms, 3): what a hand
    on an arm's link adds to u.
    """
    for a in range(3):
        grip = u[i, a] + hand[i, a] - terms.G[i, a]
        for b in range(3):
            grip -= terms.M[i, a, b] * x_ddot[b] + terms.C[i, a, b] * v[b]
        force[a] = grip


@inlined
def payload_force(grips, i, u, x_ddot, ws, force):
    """force (3,) = J_iᵀf_i of arm i: `grip_force`, or the load of a compliant grip."""
    if grips is None:
        grip_force(ws.arm, i, u, ws.hand, x_ddot, ws.velocity, force)
    else:
        for a in range(3):
            force[a] = ws.grips.load[i, a]


def internal_force_by_eq_26(
    beam: BeamMatrices,
    D: np.ndarray,
    M_bar: np.ndarray,
    C_bar: np.ndarray,
    G_bar: np.ndarray,
    u: np.ndarray,
    pose: np.ndarray,
    pose_rate: np.ndarray,
    q: np.ndarray,
    q_dot: np.ndarray,
    gravity: float = 0.0,
) -> np.ndarray:
    """F_i of two arms by Eq. (26) in nodal coordinates, with the sign of Eqs. (13) to (15), (2, 3).

    D: nodal damping matrix (n_q, n_q); M_bar, C_bar (2, 3, 3), G_bar, u (2, 3). The printed equation leaves out damping
    and weight, which here join K_F q and Ḡ, and has the opposite sign.
    """
    A, C, weight = payload_matrices(beam, pose, pose_rate, q, q_dot, gravity)
    A11, A12, A21, A22 = A[:3, :3], A[:3, 3:], A[3:, :3], A[3:, 3:]
    vibration = C[3:, :3] @ pose_rate + C[3:, 3:] @ q_dot + beam.K_F @ q + D @ q_dot + weight[3:]
    coupling = A12 @ np.linalg.solve(A22, vibration)
    schur = A11 - A12 @ np.linalg.solve(A22, A21)
    drive = u.sum(axis=0) - (C_bar.sum(axis=0) + C[:3, :3]) @ pose_rate - C[:3, 3:] @ q_dot
    drive = drive - G_bar.sum(axis=0) - weight[:3] + coupling
    x_ddot = np.linalg.solve(M_bar.sum(axis=0) + schur, drive)
    printed = [
        -u[i]
        - coupling / 2
        + (C_bar[i] + C[:3, :3] / 2) @ pose_rate
        + C[:3, 3:] @ q_dot / 2
        + G_bar[i]
        + weight[:3] / 2
        + (M_bar[i] + schur / 2) @ x_ddot
        for i in range(2)
    ]
    return -np.array(printed)


def payload_matrices(
    beam: BeamMatrices, pose: np.ndarray, pose_rate: np.ndarray, q: np.ndarray, q_dot: np.ndarray, gravity: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, the Christoffel matrix B and the weight of the payload (Eqs. (8) to (10)) in p = (x0, y0, θ, q).

    Shapes (N, N), (N, N), (N,) with N = 3 + n_q.
    """
    c, s, omega = np.cos(pose[2]), np.sin(pose[2]), pose_rate[2]
    e1, e2 = np.array([c, s]), np.array([-s, c])
    w_bar, w_bar_rate, Mq = beam.h @ q, beam.h @ q_dot, beam.M_q @ q
    size = 3 + len(q)
    A, B, weight = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    A[:2, :2], A[:2, 2], A[2, 2] = beam.m * np.eye(2), -w_bar * e1, beam.I + q @ Mq
    A[:2, 3:], A[2, 3:], A[3:, 3:] = np.outer(e2, beam.h), beam.g, beam.M_q
    A[2, :2], A[3:, :3] = A[:2, 2], A[:3, 3:].T
    B[:2, 2], B[:2, 3:] = -w_bar * omega * e2 - w_bar_rate * e1, -omega * np.outer(e1, beam.h)
    B[2, 2], B[2, 3:], B[3:, 2] = Mq @ q_dot, omega * Mq, -omega * Mq
    weight[1], weight[2], weight[3:] = beam.m * gravity, -gravity * s * w_bar, gravity * c * beam.h
    return A, B, weight
