"""The paper's law, Eqs. (23) and (25): adaptive sliding mode with a boundary layer."""

from typing import Literal

import numpy as np

from flexlab.compiled import inlined, pluggable
from flexlab.control.controller import Controller
from flexlab.control.law import BOUND_ESTIMATES, Law
from flexlab.control.load_sharing import drive_arms
from flexlab.control.rates import largest_ratio
from flexlab.quantities import Number, OneOrThree, Triple, quantity


class AdaptiveSlidingMode(Controller):
    """Zhang & Li's law, Eqs. (23) and (25)."""

    kind: Literal["adaptive-sliding-mode"] = "adaptive-sliding-mode"
    feedback_gain: OneOrThree = quantity(
        200.0, title="Feedback gain", symbol="K", unit="N·s/m, N·m·s/rad", low=0, high=1e6, slider=(0, 1000)
    )
    sliding_slope: OneOrThree = quantity(
        50.0, title="Sliding slope", symbol="Λ", unit="1/s", low=0, high=1e4, slider=(1, 200)
    )
    boundary_layer: Number = quantity(
        0.1, title="Boundary layer", symbol="ε", unit="m/s", low=1e-9, high=1e3, slider=(0.001, 1), logarithmic=True
    )
    adaptation: Triple = quantity(
        (10.0, 10.0, 10.0),
        title="Adaptation (k0, k1, k2)",
        symbol="k",
        unit="m/N, m³/N, m⁵/(N·s⁴)",
        low=1e-6,
        high=1e12,
        slider=(0.1, 1000),
        logarithmic=True,
    )


@inlined
def sliding_variable(Lambda, x, v, desired, s):
    """s = ẋ - ẋ_d + Λe (3,); returns ‖s‖."""
    norm2 = 0.0
    for a in range(3):
        s[a] = v[a] - desired[1, a] + Lambda[a] * (x[a] - desired[0, a])
        norm2 += s[a] * s[a]
    return np.sqrt(norm2)


@inlined
def drive_to_surface(K, Lambda, epsilon, k, now, b_hat, b_rate):
    """Fill now.u and db̂/dt (3,) for the estimates b̂ (3,)."""
    x, v, desired = now.x, now.v, now.desired
    r_dot, r, feedback, A = now.scratch[0], now.scratch[1], now.scratch[2], now.scratch[3:6]
    s_norm = sliding_variable(Lambda, x, v, desired, feedback)
    x_norm2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    v_norm2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    x_norm = np.sqrt(x_norm2)
    bound = (b_hat[0] + b_hat[1] * x_norm + b_hat[2] * v_norm2) / max(s_norm, epsilon)
    for a in range(3):
        r[a] = v[a] - feedback[a]
        r_dot[a] = desired[2, a] - Lambda[a] * (v[a] - desired[1, a])
        feedback[a] *= -(K[a] + bound)
    drive_arms(now, r_dot, r, feedback, A)
    # The proof needs ‖x‖ and ‖ẋ‖² here; the print of Eq. (23) has one dot too many in each.
    b_rate[0] = s_norm / k[0]
    b_rate[1] = s_norm * x_norm / k[1]
    b_rate[2] = s_norm * v_norm2 / k[2]


@pluggable
def adaptive_sliding_mode(gains, now, b_hat, b_rate, signals):
    """Eqs. (23) and (25)."""
    drive_to_surface(
        gains.feedback_gain, gains.sliding_slope, gains.boundary_layer, gains.adaptation, now, b_hat, b_rate
    )


@inlined
def surface_rate(K, Lambda, epsilon, now, b_hat, S):
    """Fastest rate of s within the boundary layer, 1/s: S⁻¹(K + bound/ε), and Λ after it."""
    x, v = now.x, now.v
    v_norm2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    bound = b_hat[0] + b_hat[1] * np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) + b_hat[2] * v_norm2
    gain = now.scratch[0]
    for a in range(3):
        gain[a] = K[a] + bound / epsilon
    return largest_ratio(S, gain, now.scratch[3:6]) + max(Lambda)


@pluggable
def fastest_rate(gains, now, b_hat, S, kappa):
    """1/s."""
    return surface_rate(gains.feedback_gain, gains.sliding_slope, gains.boundary_layer, now, b_hat, S)


def sliding_slope(law: AdaptiveSlidingMode) -> np.ndarray:
    """Λ (3,)."""
    return np.array(np.broadcast_to(law.sliding_slope, 3), dtype=float)


def limits(law: AdaptiveSlidingMode) -> dict[str, dict[str, float]]:
    """Within the boundary layer the law is smooth."""
    return {"sliding_variable": {"boundary layer ε (m/s)": law.boundary_layer}}


LAW = Law(
    AdaptiveSlidingMode,
    adaptive_sliding_mode,
    fastest_rate,
    (BOUND_ESTIMATES,),
    sliding_slope=sliding_slope,
    limits=limits,
    place=10,
)
