"""The paper's law with active damping of the beam, which the paper leaves as future work.

The beam sees the arms only through the lateral and angular acceleration of the virtual link. Accelerating the link by
a_lat = k_v hᵀq̇ along e2 and α = k_θ gᵀq̇ takes energy out of every mode that this motion can reach.
"""

from typing import Literal

from flexlab.compiled import inlined, pluggable
from flexlab.control.conditions import Circumstances, Condition, fed_modes, within_layer
from flexlab.control.law import BOUND_ESTIMATES, Law
from flexlab.control.laws.adaptive_sliding_mode import AdaptiveSlidingMode, drive_to_surface, surface_rate
from flexlab.control.sliding_surface import layer_of, slope_of
from flexlab.quantities import Number, quantity


class VibrationDamping(AdaptiveSlidingMode):
    """The paper's law with active damping of the beam (its future work): a_lat = k_v hᵀq̇, α = k_θ gᵀq̇."""

    kind: Literal["vibration-damping"] = "vibration-damping"
    lateral_vibration_gain: Number = quantity(
        100.0, "Lateral vibration gain", "k_v", "1/(kg·s)", low=0, high=1e5, slider=(0, 300)
    )
    angular_vibration_gain: Number = quantity(
        0.0, "Angular vibration gain", "k_θ", "1/(kg·m²·s)", low=0, high=1e6, slider=(0, 3000)
    )


@inlined
def add_link_acceleration(now, lateral, turn):
    """u += (ΣM̄_i)[lateral e2; turn] by the arms' shares."""
    ax, ay = -now.trig[1] * lateral, now.trig[0] * lateral
    for a in range(3):
        total = 0.0
        for i in range(now.arm_count):
            total += now.M[i, a, 0] * ax + now.M[i, a, 1] * ay + now.M[i, a, 2] * turn
        for i in range(now.arm_count):
            now.u[i, a] += now.share[i] * total


@pluggable
def vibration_damping(gains, now, b_hat, b_rate, signals):
    """The paper's law, and u += (ΣM̄_i)[a_lat e2; α]."""
    K, Lambda, epsilon = gains.feedback_gain, gains.sliding_slope, gains.boundary_layer
    drive_to_surface(K, Lambda, epsilon, gains.adaptation, gains.leakage, now, b_hat, b_rate)
    lateral, turn = gains.lateral_vibration_gain, gains.angular_vibration_gain
    add_link_acceleration(now, lateral * now.beam_rate[0], turn * now.beam_rate[1])


@pluggable
def fastest_rate(gains, now, b_hat, S, kappa):
    """Fastest rate, 1/s: that of the paper's law, plus the rate at which the vibration gains damp hᵀq̇ and gᵀq̇."""
    vibration = gains.lateral_vibration_gain * kappa[0] + gains.angular_vibration_gain * kappa[2]
    K, Lambda, epsilon = gains.feedback_gain, gains.sliding_slope, gains.boundary_layer
    return surface_rate(K, Lambda, epsilon, now, b_hat, S) + vibration


def conditions(around: Circumstances) -> tuple[Condition, ...]:
    """The conditions of the paper's law, and that late torques drive no mode."""
    law = around.scenario.controller
    return within_layer(around), *fed_modes(around, (law.lateral_vibration_gain, law.angular_vibration_gain))


LAW = Law(
    VibrationDamping,
    vibration_damping,
    fastest_rate,
    (BOUND_ESTIMATES,),
    sliding_slope=slope_of,
    limits=layer_of,
    conditions=conditions,
    relies_on_masses=True,
    place=20,
)
