"""Sliding mode with a constant bound (the paper's reference [13]): the paper's own law without the adaptation.

    Σu_i = B ṙ + C̄ r + Ḡ - K s - ρ̂ s/max(‖s‖, ε)

with e = x - x_d, r = ẋ_d - Λe, s = ẋ - r (3,), B = ΣM̄_i + Ā as the controller believes the payload; the arm's own part goes
to arm i, the rest by the load share. Units: s in m/s and rad/s, K in N·s/m and N·m·s/rad, ρ̂ in N.
Stability: V = ½ sᵀBs falls at least as fast as sᵀKs outside the boundary layer if K > 0 and ρ̂ ≥ ‖Ψ‖, the beam's reaction
on the pose, at all times. That needs the bound to be known beforehand (the paper's law learns it) and the beam's motion to
be bounded: damping, or a path off its resonances. Within the layer ‖s‖ ends below about ε ‖Ψ‖/ρ̂.
"""

from typing import Literal

from flexlab.compiled import pluggable
from flexlab.control.conditions import Circumstances, Condition, n
from flexlab.control.controller import Controller
from flexlab.control.law import Law
from flexlab.control.law_kernels import drive_arms
from flexlab.control.sliding_surface import aim_at_surface, layer_of, layer_rate, slope_of
from flexlab.quantities import Number, OneOrThree, quantity


class SlidingMode(Controller):
    """Sliding mode with a constant bound on the beam's reaction (the paper's reference [13])."""

    kind: Literal["sliding-mode"] = "sliding-mode"
    feedback_gain: OneOrThree = quantity(
        200.0, "Feedback gain", "K", "N·s/m, N·m·s/rad", low=0, high=1e6, slider=(0, 1000)
    )
    sliding_slope: OneOrThree = quantity(50.0, "Sliding slope", "Λ", "1/s", low=0, high=1e4, slider=(1, 200))
    boundary_layer: Number = quantity(
        0.1, "Boundary layer", "ε", "m/s", low=1e-9, high=1e3, slider=(0.001, 1), logarithmic=True
    )
    bound: Number = quantity(30.0, "Constant bound", "ρ̂", "N", low=0, high=1e6, slider=(0, 200))


@pluggable
def sliding_mode(gains, now, memory, memory_rate, signals):
    """ū3 = -ρ̂ s/max(‖s‖, ε)."""
    s_norm = aim_at_surface(gains.sliding_slope, now)
    r_dot, r, feedback, A = now.scratch[0], now.scratch[1], now.scratch[2], now.scratch[3:6]
    switching = gains.bound / max(s_norm, gains.boundary_layer)
    for a in range(3):
        feedback[a] *= -(gains.feedback_gain[a] + switching)
    drive_arms(now, r_dot, r, feedback, A)


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    """Fastest rate within the boundary layer, 1/s."""
    return layer_rate(gains.feedback_gain, gains.sliding_slope, gains.bound / gains.boundary_layer, now, S)


def conditions(around: Circumstances) -> tuple[Condition, ...]:
    """ρ̂ ≥ ‖Ψ‖ on the path."""
    bound, force = around.scenario.controller.bound, around.largest_reaction
    return (
        Condition(f"ρ̂ ≥ ‖Ψ‖: {n(bound)} N against the beam's reaction on this path, {n(force)} N.", bound >= force),
    )


LAW = Law(
    SlidingMode,
    sliding_mode,
    fastest_rate,
    sliding_slope=slope_of,
    limits=layer_of,
    conditions=conditions,
    relies_on_masses=True,
    place=12,
)
