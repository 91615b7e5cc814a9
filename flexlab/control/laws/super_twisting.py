"""Super-twisting: second-order sliding mode whose switching is integrated, so that the torques are continuous.

    Σu_i = B ṙ + C̄ r + Ḡ - k1 s/√max(‖s‖, ε) + w,   dw/dt = -k2 s/max(‖s‖, ε),   w(0) = 0

with e = x - x_d, r = ẋ_d - Λe, s = ẋ - r (3,), B = ΣM̄_i + Ā as the controller believes the payload; k1, k2 one number each
or one per coordinate. Levant (Int. J. Control 58(6), 1993) for one coordinate; the unit-vector form for several is that of
Nagesh and Edwards (Automatica 50(3), 2014). w (3,), N, N, N·m, is the law's memory.
Stability: with one inertia b and a reaction of the beam that changes by |dΨ/dt| ≤ δ, s and ds/dt reach zero in finite time if
k2 > δ and k1² > 4 b δ (k2 + δ)/(k2 - δ) (Levant); then -w = Ψ. V is a quadratic form in (s/√‖s‖, w + Ψ), as Moreno and
Osorio (2008) give it. Within ‖s‖ < ε the law is linear, and V = ½ sᵀBs + ε‖w + Ψ‖²/(2 k2) obeys
dV/dt = -k1 ‖s‖²/√ε + (ε/k2) (w + Ψ)·dΨ/dt: s stays within about ε^¾ √(δ‖w + Ψ‖/(k1 k2)). A ringing beam has a large dΨ/dt:
k2 must exceed its force times its frequency, or the law does not cancel the ring.
"""

from typing import Literal

import numpy as np

from flexlab.compiled import pluggable
from flexlab.control.conditions import Circumstances, Condition, n
from flexlab.control.controller import Controller
from flexlab.control.law import Law, Memory
from flexlab.control.law_kernels import drive_arms
from flexlab.control.rates import largest_ratio
from flexlab.control.sliding_surface import aim_at_surface, layer_of, sliding_variable, slope_of
from flexlab.quantities import Number, OneOrThree, quantity
from flexlab.signal import AXIS, Signal


class SuperTwisting(Controller):
    """Super-twisting sliding mode: continuous torques that still reach the surface in finite time."""

    kind: Literal["super-twisting"] = "super-twisting"
    proportional_gain: OneOrThree = quantity(
        120.0, "Root gain", "k1", "N·√(s/m), N·m·√(s/rad)", low=0, high=1e6, slider=(0, 500)
    )
    integral_gain: OneOrThree = quantity(200.0, "Switching gain", "k2", "N/s, N·m/s", low=0, high=1e7, slider=(0, 2000))
    sliding_slope: OneOrThree = quantity(50.0, "Sliding slope", "Λ", "1/s", low=0, high=1e4, slider=(1, 200))
    boundary_layer: Number = quantity(
        0.1, "Boundary layer", "ε", "m/s", low=1e-9, high=1e3, slider=(0.001, 1), logarithmic=True
    )


@pluggable
def super_twisting(gains, now, w, w_rate, signals):
    """-k1 s/√max(‖s‖, ε) + w and dw/dt."""
    s_norm = aim_at_surface(gains.sliding_slope, now)
    r_dot, r, feedback, A = now.scratch[0], now.scratch[1], now.scratch[2], now.scratch[3:6]
    size = max(s_norm, gains.boundary_layer)
    root = np.sqrt(size)
    for a in range(3):
        w_rate[a] = -gains.integral_gain[a] * feedback[a] / size
        feedback[a] = -gains.proportional_gain[a] * feedback[a] / root + w[a]
        signals[a] = w[a]
    drive_arms(now, r_dot, r, feedback, A)


NEAR_EDGE, EDGE_RATE, FASTEST_EDGE = 2.0, 8.0, 1e4
"""Within the factor `NEAR_EDGE` of the boundary layer's edge, the law's rate is stated `EDGE_RATE` times larger, up to
`FASTEST_EDGE`, 1/s: a step across the edge, where the slope of k1 s/√‖s‖ jumps, is of second order, and w keeps the error."""


@pluggable
def fastest_rate(gains, now, w, S, kappa):
    """Fastest rate within the boundary layer, 1/s: S⁻¹k1/√ε, plus √(S⁻¹k2/ε), plus Λ; several times that at its edge."""
    epsilon, gain, scratch = gains.boundary_layer, now.scratch[0], now.scratch[3:6]
    away = sliding_variable(gains.sliding_slope, now.x, now.v, now.desired, gain) / epsilon
    for a in range(3):
        gain[a] = gains.proportional_gain[a] / np.sqrt(epsilon)
    damping = largest_ratio(S, gain, scratch)
    for a in range(3):
        gain[a] = gains.integral_gain[a] / epsilon
    rate = damping + np.sqrt(largest_ratio(S, gain, scratch)) + max(gains.sliding_slope)
    at_edge = away < NEAR_EDGE and away * NEAR_EDGE > 1
    return max(rate, min(EDGE_RATE * rate, FASTEST_EDGE)) if at_edge else rate


def conditions(around: Circumstances) -> tuple[Condition, ...]:
    """Levant's conditions, with the largest inertia and the largest change of the beam's reaction on the path."""
    law, rate = around.scenario.controller, around.largest_reaction_rate
    k1, k2 = float(np.min(law.proportional_gain)), float(np.min(law.integral_gain))
    inertia = float(np.linalg.eigvalsh(around.inertias()).max())
    enough = k2 > rate
    change = f"{n(rate)} N/s by which the beam's reaction changes on this path"
    if not np.isfinite(rate):
        change = "a reaction of the beam that jumps with the path's acceleration, so that no k2 is enough"
    needed = np.sqrt(4 * inertia * rate * (k2 + rate) / (k2 - rate)) if enough else np.inf
    return (
        Condition(f"k2 > δ: {n(k2)} N/s against {change}.", enough),
        Condition(
            f"k1² > 4 b δ (k2 + δ)/(k2 − δ): k1 = {n(k1)} against {n(needed)}, b = {n(inertia)} kg.", k1 > needed
        ),
    )


LAW = Law(
    SuperTwisting,
    super_twisting,
    fastest_rate,
    (Memory("twisting_force"),),
    (Signal("twisting_force", "w", ("N", "N", "N·m"), "integrated switching force", (AXIS,)),),
    sliding_slope=slope_of,
    limits=layer_of,
    conditions=conditions,
    relies_on_masses=True,
    place=14,
)
