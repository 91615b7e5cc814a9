"""The paper's law, Eqs. (23) and (25): adaptive sliding mode with a boundary layer.

    Σu_i = B ṙ + C̄ r + Ḡ - K s - b̂ᵀ(1, ‖x‖, ‖ẋ‖²) s/max(‖s‖, ε),   db̂/dt = ‖s‖(1, ‖x‖, ‖ẋ‖²)/k - σ b̂

with e = x - x_d, r = ẋ_d - Λe, s = ẋ - r, and B = ΣM̄_i + Ā the inertia as the controller believes it.
Stability (Theorem 1): V = ½ sᵀBs + ½ Σ k_j (b_j - b̂_j)² falls at least as fast as sᵀKs while ‖s‖ > ε, for any K > 0 and
k_j > 0, if the beam's reaction obeys ‖Ψ‖ ≤ b_0 + b_1‖x‖ + b_2‖ẋ‖² (Eq. (22)) with any constants b_j. That assumption needs a
damped beam, or a motion off its resonances: in an undamped one nothing bounds the vibration, and with it Ψ.
Without leakage b̂ never falls, so that noise in s makes it drift upwards for ever. `leakage` σ > 0 (the σ-modification of
Ioannou & Kokotović, 1983) lets it fade to where growth and leakage balance; V then falls only outside a ball about s = 0.
"""

from typing import Literal

import numpy as np

from flexlab.compiled import inlined, pluggable
from flexlab.control.conditions import Circumstances, Condition, within_layer
from flexlab.control.controller import Controller
from flexlab.control.law import BOUND_ESTIMATES, Law
from flexlab.control.law_kernels import drive_arms
from flexlab.control.sliding_surface import aim_at_surface, layer_of, layer_rate, slope_of
from flexlab.quantities import Number, OneOrThree, Triple, quantity


class AdaptiveSlidingMode(Controller):
    """Zhang & Li's law, Eqs. (23) and (25)."""

    kind: Literal["adaptive-sliding-mode"] = "adaptive-sliding-mode"
    feedback_gain: OneOrThree = quantity(
        200.0, "Feedback gain", "K", "N·s/m, N·m·s/rad", low=0, high=1e6, slider=(0, 1000)
    )
    sliding_slope: OneOrThree = quantity(50.0, "Sliding slope", "Λ", "1/s", low=0, high=1e4, slider=(1, 200))
    boundary_layer: Number = quantity(
        0.1, "Boundary layer", "ε", "m/s", low=1e-9, high=1e3, slider=(0.001, 1), logarithmic=True
    )
    adaptation: Triple = quantity(
        (10.0, 10.0, 10.0), "Adaptation (k0, k1, k2)", "k", "m/N, m³/N, m⁵/(N·s⁴)", low=1e-6, high=1e12,
        slider=(0.1, 1000), logarithmic=True,
    )  # fmt: skip
    leakage: Number = quantity(0.0, "Leakage of the bound estimates", "σ", "1/s", low=0, high=1e4, slider=(0, 5))


@inlined
def drive_to_surface(K, Lambda, epsilon, k, leakage, now, b_hat, b_rate):
    """Fill now.u and db̂/dt (3,) for the estimates b̂ (3,)."""
    x, v = now.x, now.v
    s_norm = aim_at_surface(Lambda, now)
    r_dot, r, feedback, A = now.scratch[0], now.scratch[1], now.scratch[2], now.scratch[3:6]
    x_norm2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2]
    v_norm2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    x_norm = np.sqrt(x_norm2)
    bound = (b_hat[0] + b_hat[1] * x_norm + b_hat[2] * v_norm2) / max(s_norm, epsilon)
    for a in range(3):
        feedback[a] *= -(K[a] + bound)
    drive_arms(now, r_dot, r, feedback, A)
    # The proof needs ‖x‖ and ‖ẋ‖² here; the print of Eq. (23) has one dot too many in each.
    b_rate[0] = s_norm / k[0] - leakage * b_hat[0]
    b_rate[1] = s_norm * x_norm / k[1] - leakage * b_hat[1]
    b_rate[2] = s_norm * v_norm2 / k[2] - leakage * b_hat[2]


@pluggable
def adaptive_sliding_mode(gains, now, b_hat, b_rate, signals):
    """Eqs. (23) and (25)."""
    K, Lambda, epsilon = gains.feedback_gain, gains.sliding_slope, gains.boundary_layer
    drive_to_surface(K, Lambda, epsilon, gains.adaptation, gains.leakage, now, b_hat, b_rate)


@inlined
def surface_rate(K, Lambda, epsilon, now, b_hat, S):
    """Fastest rate of s within the boundary layer, 1/s: that of S⁻¹(K + bound/ε), plus Λ."""
    x, v = now.x, now.v
    v_norm2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    bound = b_hat[0] + b_hat[1] * np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) + b_hat[2] * v_norm2
    return layer_rate(K, Lambda, bound / epsilon, now, S)


@pluggable
def fastest_rate(gains, now, b_hat, S, kappa):
    """Fastest rate of the closed loop, 1/s."""
    return surface_rate(gains.feedback_gain, gains.sliding_slope, gains.boundary_layer, now, b_hat, S)


def conditions(around: Circumstances) -> tuple[Condition, ...]:
    """Theorem 1 holds for any K, k > 0; how small s becomes depends on K."""
    return (within_layer(around),)


LAW = Law(
    AdaptiveSlidingMode,
    adaptive_sliding_mode,
    fastest_rate,
    (BOUND_ESTIMATES,),
    sliding_slope=slope_of,
    limits=layer_of,
    conditions=conditions,
    relies_on_masses=True,
    place=10,
)
