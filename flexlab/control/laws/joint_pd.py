"""PD control of each joint by itself with weight compensation, as in industrial arms.

    τ_i = G_i(θ_i) + 𝒥_i⁻ᵀ share_i (0, m g, 0) - P (θ_i - θ_i,d) - D (dθ_i/dt - dθ_i,d/dt)

θ_i (3,): relative joint angles of arm i, rad; θ_i,d and its rate follow from x_d and ẋ_d by the arm's inverse kinematics with
the same elbow. P in N·m/rad and D in N·m·s/rad, one number per joint, the same for both arms; τ_i in N·m. As u_i = 𝒥_iᵀτ_i,
the weight is share_i (0, m g, 0), as with every law.
Stability (Takegaki and Arimoto 1981): with the target at rest and the weight known, V = T + U_beam + ½ Σ (θ_i - θ_i,d)ᵀP
(θ_i - θ_i,d) obeys dV/dt = -Σ dθ_i/dtᵀ D dθ_i/dt - q̇ᵀDq̇ ≤ 0 for any P, D > 0 and any beam: no model is needed. On a moving
path nothing is fed forward and the error stays of the size of (inertia · ẍ_d)/P. Each arm pulls the payload to where its own
joints belong, so that errors in the position of the bases would become internal force.
"""

from typing import Literal

import numpy as np

from flexlab.compiled import inlined, pluggable
from flexlab.control.controller import Controller
from flexlab.control.law import Law
from flexlab.control.rates import largest_form_ratio
from flexlab.numerics.elementary import direction_angle, sin_cos
from flexlab.physics.arm import link_directions, task_input
from flexlab.physics.law_input import MOST_ARMS
from flexlab.quantities import Triple, quantity


class JointProportionalDerivative(Controller):
    """PD on the joint angles of each arm, with weight compensation and no inertia known."""

    kind: Literal["joint-pd"] = "joint-pd"
    position_gain: Triple = quantity(
        (20000.0, 20000.0, 4000.0), "Position gain (θ1, θ2, θ3)", "P", "N·m/rad", low=0, high=1e8, slider=(0, 100000)
    )
    velocity_gain: Triple = quantity(
        (600.0, 600.0, 120.0), "Velocity gain (θ1, θ2, θ3)", "D", "N·m·s/rad", low=0, high=1e6, slider=(0, 3000)
    )


@inlined
def joint_errors(now, geometry, J, direction, error, rate_error):
    """Fill θ_i - θ_i,d, rad, and its rate, rad/s, (3,) each, of one arm; geometry: as `geometry_of`."""
    base_x, base_y, l1, l2, elbow, reach = geometry
    x_d, v_d, v = now.desired[0], now.desired[1], now.v
    s, c = sin_cos(x_d[2])
    rx, ry = x_d[0] + reach * c - base_x, x_d[1] + reach * s - base_y
    sin_d, cos_d, c1, s1, c2, s2 = link_directions(l1, l2, elbow, rx, ry)
    wx, wy = v_d[0] - reach * s * v_d[2], v_d[1] + reach * c * v_d[2]
    first, second = (c2 * wx + s2 * wy) / (l1 * sin_d), -(c1 * wx + s1 * wy) / (l2 * sin_d)
    C1, S1, C2, S2 = direction[0], direction[1], direction[2], direction[3]
    turned = direction_angle(S1 * c1 - C1 * s1, C1 * c1 + S1 * s1)
    sine, cosine = C1 * S2 - S1 * C2, C1 * C2 + S1 * S2
    bent = direction_angle(sine * cos_d - cosine * sin_d, cosine * cos_d + sine * sin_d)
    error[0], error[1], error[2] = turned, bent, now.x[2] - x_d[2] - turned - bent
    for a in range(3):
        first -= J[0, a] * v[a]
        second -= J[1, a] * v[a]
    rate_error[0], rate_error[1], rate_error[2] = -first, first - second, v[2] - v_d[2] + second


@pluggable
def joint_proportional_derivative(gains, now, memory, memory_rate, signals):
    """u_i = Ḡ_i + share weight - 𝒥ᵀ(P Δθ_i + D Δθ̇_i), (arms, 3)."""
    error, rate_error, tau = now.scratch[0], now.scratch[1], now.scratch[2]
    for i in range(now.arm_count):
        geometry, u = gains.geometry[i], now.u[i]
        numbers = geometry[0], geometry[1], geometry[2], geometry[3], geometry[4], geometry[5]
        joint_errors(now, numbers, now.J[i], now.direction[i], error, rate_error)
        for a in range(3):
            tau[a] = -gains.position_gain[a] * error[a] - gains.velocity_gain[a] * rate_error[a]
        task_input(now.J[i], tau, u)
        for a in range(3):
            u[a] += now.G[i, a]
        u[1] += now.share[i] * now.m * now.gravity


@inlined
def in_task_space(now, gain, Q):
    """Q = Σ_i 𝒥_iᵀ diag(gain) 𝒥_i (3, 3) for relative joints."""
    row = now.scratch[0]
    for a in range(3):
        for b in range(3):
            Q[a, b] = 0.0
    for i in range(now.arm_count):
        J = now.J[i]
        for k in range(3):
            for a in range(3):
                outer, inner = J[1, a] if k == 1 else (1.0 if a == 2 else 0.0), J[0, a] if k == 1 else J[1, a]
                row[a] = J[0, a] if k == 0 else outer - inner
            for a in range(3):
                for b in range(3):
                    Q[a, b] += gain[k] * row[a] * row[b]


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """Fastest rate, 1/s: that of the damping, S⁻¹Σ𝒥ᵀD𝒥, plus that of the stiffness, √(S⁻¹Σ𝒥ᵀP𝒥)."""
    Q, B = now.scratch[1:4], now.scratch[4:7]
    in_task_space(now, gains.velocity_gain, Q)
    damping = largest_form_ratio(S, Q, B)
    in_task_space(now, gains.position_gain, Q)
    return damping + np.sqrt(largest_form_ratio(S, Q, B))


def geometry_of(scenario) -> dict[str, np.ndarray]:
    """Per arm: base (x, y), l1, l2, m; elbow side; distance from the payload's origin to the wrist along e1, m."""
    geometry = np.ones((MOST_ARMS, 6))
    for i, arm in enumerate(scenario.arms):
        side = -1 if i == 0 else 1
        reach = side * (scenario.payload.length / 2 + arm.link_length[2])
        geometry[i] = *arm.base, *arm.link_length[:2], arm.elbow, reach
    return {"geometry": geometry}


LAW = Law(
    JointProportionalDerivative,
    joint_proportional_derivative,
    fastest_rate,
    constants={"geometry": (MOST_ARMS, 6)},
    derive=geometry_of,
    untouched=("position_gain", "velocity_gain"),
    place=45,
)
