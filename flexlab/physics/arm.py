"""One planar three-joint arm whose last link is rigidly aligned with the virtual link (Eqs. (11), (12), (13)).

The arm's dynamics are written in the links' absolute angles α = (α1, α2, φ): the mass matrix is μ_ij cos(α_i - α_j), its
Christoffel matrix μ_ij sin(α_i - α_j) α̇_j, and no joint angle is needed. As φ = θ (or θ + π), the pose fixes the
wrist, and α1, α2 follow from the triangle base-elbow-wrist. 𝒥: ẋ → α̇ has rows 𝒥_1, 𝒥_2 and (0, 0, 1).
"""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import disjoint, inlined
from flexlab.numerics.elementary import direction_angle

ARM = np.dtype(
    [
        ("base_x", "f8"),
        ("base_y", "f8"),
        ("l1", "f8"),
        ("l2", "f8"),
        ("elbow", "f8"),
        ("reach", "f8"),
        ("tip", "f8"),
        ("mu_11", "f8"),
        ("mu_12", "f8"),
        ("mu_13", "f8"),
        ("mu_22", "f8"),
        ("mu_23", "f8"),
        ("mu_33", "f8"),
        ("gamma_1", "f8"),
        ("gamma_2", "f8"),
        ("gamma_3", "f8"),
        ("mass", "f8"),
    ]
)
"""Constants of one arm: base, m; link lengths, m; elbow side; `reach`: from the payload's origin to the wrist along e1, m;
`tip`: +1 if the last link points along e1, else -1; mu: inertias, kg·m²; gamma: first moments, kg·m; mass, kg."""
SINGULAR_SINE = 0.02
"""|sin(α2 - α1)| below which an arm counts as stretched or folded: joint rates are then over 50 times the wrist's."""
OK, UNREACHABLE, SINGULAR, NOT_A_NUMBER = 0, 1, 2, 3
"""Outcomes of `arm_configuration`."""


class ArmTerms(NamedTuple):
    """Arm terms of one evaluation; first axis: arm."""

    M: np.ndarray
    """M̄_i = 𝒥ᵀM𝒥, (arms, 3, 3)."""
    C: np.ndarray
    """C̄_i = 𝒥ᵀ(C𝒥 + M𝒥̇), (arms, 3, 3)."""
    G: np.ndarray
    """Ḡ_i = 𝒥ᵀG, (arms, 3)."""
    J: np.ndarray
    """𝒥_1, 𝒥_2, (arms, 2, 3)."""
    direction: np.ndarray
    """cos α1, sin α1, cos α2, sin α2, (arms, 4)."""
    trig: np.ndarray
    """cos θ, sin θ, (2,)."""


def arm_constants(
    base: tuple[float, float],
    mass: tuple[float, ...],
    length: tuple[float, ...],
    center: tuple[float, ...],
    inertia: tuple[float, ...],
    elbow: int,
    side: int,
    payload_length: float,
) -> np.ndarray:
    """One `ARM` record. `side`: -1 grips the payload at s = -L/2, +1 at s = +L/2."""
    (m1, m2, m3), (l1, l2, l3), (a1, a2, a3) = mass, length, center
    record = np.zeros((), ARM)
    record["base_x"], record["base_y"] = base
    record["l1"], record["l2"], record["elbow"] = l1, l2, elbow
    record["reach"], record["tip"] = side * (payload_length / 2 + l3), -side
    record["mu_11"] = m1 * a1 * a1 + inertia[0] + (m2 + m3) * l1 * l1
    record["mu_22"] = m2 * a2 * a2 + inertia[1] + m3 * l2 * l2
    record["mu_33"] = m3 * a3 * a3 + inertia[2]
    record["mu_12"] = (m2 * a2 + m3 * l2) * l1
    record["mu_13"] = m3 * a3 * l1
    record["mu_23"] = m3 * a3 * l2
    record["gamma_1"] = m1 * a1 + (m2 + m3) * l1
    record["gamma_2"] = m2 * a2 + m3 * l2
    record["gamma_3"] = m3 * a3
    record["mass"] = m1 + m2 + m3
    return record


@inlined
def link_directions(l1, l2, elbow, rx, ry):
    """sin and cos of α2 - α1, and cos α1, sin α1, cos α2, sin α2, for a wrist at (rx, ry) from the base, m.

    For a wrist out of reach the cosine is beyond ±1, and the rest NaN.
    """
    # Reciprocals are computed early: a division at the end of the chain costs three products.
    distance2, per_product = rx * rx + ry * ry, 1 / (2 * l1 * l2)
    per_distance2 = 1 / distance2
    cos_elbow = (distance2 - (l1 * l1 + l2 * l2)) * per_product
    sin_elbow = elbow * np.sqrt(1 - cos_elbow * cos_elbow)
    along, across = l1 + l2 * cos_elbow, l2 * sin_elbow
    c1 = (along * rx + across * ry) * per_distance2
    s1 = (along * ry - across * rx) * per_distance2
    along, across = l2 + l1 * cos_elbow, l1 * sin_elbow
    c2 = (along * rx - across * ry) * per_distance2
    s2 = (along * ry + across * rx) * per_distance2
    return sin_elbow, cos_elbow, c1, s1, c2, s2


@disjoint
def arm_configuration(arm, x, y, c, s, g, M, G, J, direction):
    """Fill 𝒥, M̄ and Ḡ of one arm for the pose (x, y, θ); g: gravity, m/s². Returns one of the outcomes."""
    rx = x + arm.reach * c - arm.base_x
    ry = y + arm.reach * s - arm.base_y
    sin_elbow, cos_elbow, c1, s1, c2, s2 = link_directions(arm.l1, arm.l2, arm.elbow, rx, ry)
    if not abs(cos_elbow) <= 1:
        return UNREACHABLE if np.isfinite(cos_elbow) else NOT_A_NUMBER
    if abs(sin_elbow) < SINGULAR_SINE:
        return SINGULAR
    direction[0], direction[1], direction[2], direction[3] = c1, s1, c2, s2

    first, second = 1 / (arm.l1 * sin_elbow), -1 / (arm.l2 * sin_elbow)
    Jx, Jy, Jt = first * c2, first * s2, first * arm.reach * (s2 * c - c2 * s)
    Kx, Ky, Kt = second * c1, second * s1, second * arm.reach * (s1 * c - c1 * s)
    J[0, 0], J[0, 1], J[0, 2] = Jx, Jy, Jt
    J[1, 0], J[1, 1], J[1, 2] = Kx, Ky, Kt

    M12 = arm.mu_12 * cos_elbow
    M13 = arm.mu_13 * arm.tip * (c1 * c + s1 * s)
    M23 = arm.mu_23 * arm.tip * (c2 * c + s2 * s)
    # M𝒥 by columns, and one half of the symmetric 𝒥ᵀM𝒥.
    H1, H2 = arm.mu_11 * Jx + M12 * Kx, M12 * Jx + arm.mu_22 * Kx
    Mxx, Mxy = H1 * Jx + H2 * Kx, H1 * Jy + H2 * Ky
    H1, H2 = arm.mu_11 * Jy + M12 * Ky, M12 * Jy + arm.mu_22 * Ky
    Myy = H1 * Jy + H2 * Ky
    H1, H2 = arm.mu_11 * Jt + M12 * Kt + M13, M12 * Jt + arm.mu_22 * Kt + M23
    H3 = M13 * Jt + M23 * Kt + arm.mu_33
    Mxt, Myt, Mtt = H1 * Jx + H2 * Kx, H1 * Jy + H2 * Ky, H1 * Jt + H2 * Kt + H3
    M[0, 0], M[0, 1], M[0, 2] = Mxx, Mxy, Mxt
    M[1, 0], M[1, 1], M[1, 2] = Mxy, Myy, Myt
    M[2, 0], M[2, 1], M[2, 2] = Mxt, Myt, Mtt
    G1, G2, G3 = g * arm.gamma_1 * c1, g * arm.gamma_2 * c2, g * arm.gamma_3 * arm.tip * c
    G[0], G[1], G[2] = G1 * Jx + G2 * Kx, G1 * Jy + G2 * Ky, G1 * Jt + G2 * Kt + G3
    return OK


@disjoint
def arm_velocity_terms(arm, c, s, vx, vy, w, J, direction, C):
    """Fill C̄ of one arm for the pose rate (vx, vy, w), after `arm_configuration`."""
    c1, s1, c2, s2 = direction[0], direction[1], direction[2], direction[3]
    cos_elbow, sin_elbow = c1 * c2 + s1 * s2, c1 * s2 - s1 * c2
    a1 = J[0, 0] * vx + J[0, 1] * vy + J[0, 2] * w
    a2 = J[1, 0] * vx + J[1, 1] * vy + J[1, 2] * w
    c1p, s1p = c1 * c + s1 * s, s1 * c - c1 * s
    c2p, s2p = c2 * c + s2 * s, s2 * c - c2 * s
    first, second = 1 / (arm.l1 * sin_elbow), -1 / (arm.l2 * sin_elbow)
    shrink = cos_elbow / sin_elbow * (a2 - a1)
    M12, M13, M23 = arm.mu_12 * cos_elbow, arm.mu_13 * arm.tip * c1p, arm.mu_23 * arm.tip * c2p
    C12, C13, C23 = -arm.mu_12 * sin_elbow, arm.mu_13 * arm.tip * s1p, arm.mu_23 * arm.tip * s2p
    for b in range(3):
        if b == 0:
            J1_dot, J2_dot, third = -first * a2 * s2, -second * a1 * s1, 0.0
        elif b == 1:
            J1_dot, J2_dot, third = first * a2 * c2, second * a1 * c1, 0.0
        else:
            J1_dot = first * arm.reach * (a2 - w) * c2p
            J2_dot = second * arm.reach * (a1 - w) * c1p
            third = 1.0
        J1_dot -= J[0, b] * shrink
        J2_dot -= J[1, b] * shrink
        H1 = C12 * a2 * J[1, b] + C13 * w * third + arm.mu_11 * J1_dot + M12 * J2_dot
        H2 = -C12 * a1 * J[0, b] + C23 * w * third + M12 * J1_dot + arm.mu_22 * J2_dot
        H3 = -C13 * a1 * J[0, b] - C23 * a2 * J[1, b] + M13 * J1_dot + M23 * J2_dot
        for a in range(3):
            C[a, b] = J[0, a] * H1 + J[1, a] * H2
        C[2, b] += H3


@disjoint
def joint_torques(arm, c, s, direction, u, tau):
    """Torques of the relative joints, N·m (3,), that do the work of the task-space input u (3,): u = 𝒥ᵀτ."""
    on_first = arm.l1 * (direction[0] * u[1] - direction[1] * u[0])
    on_second = arm.l2 * (direction[2] * u[1] - direction[3] * u[0])
    on_third = u[2] - arm.reach * (c * u[1] - s * u[0])
    # Relative joints: torque of joint k acts on all links from k outwards. The wrist force does no work on link 3's turn.
    tau[2] = on_third
    tau[1] = on_second + on_third
    tau[0] = on_first + on_second + on_third


@disjoint
def task_input(J, tau, u):
    """u = 𝒥ᵀτ (3,) of relative joint torques τ (3,)."""
    on_first, on_second = tau[0] - tau[1], tau[1] - tau[2]
    for a in range(3):
        u[a] = J[0, a] * on_first + J[1, a] * on_second
    u[2] += tau[2]


@disjoint
def joint_angles(theta, arm, direction, angle):
    """Relative joint angles, rad (3,), after `arm_configuration`."""
    alpha_1 = direction_angle(direction[1], direction[0])
    c1, s1, c2, s2 = direction[0], direction[1], direction[2], direction[3]
    angle[0] = alpha_1
    angle[1] = direction_angle(c1 * s2 - s1 * c2, c1 * c2 + s1 * s2)
    angle[2] = theta + (np.pi if arm.tip < 0 else 0.0) - alpha_1 - angle[1]
