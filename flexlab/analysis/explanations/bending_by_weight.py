"""The part of the bending that the weight holds."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import register
from flexlab.analysis.lesson_measures import largest, length, newest

AGREES = 0.1
"""Relative difference up to which the mean bending is the weight's."""


@register("bending by weight", "w(0) = -5 ρ g L⁴ cos θ / (384 EI), pinned grips", "Mid-span deflection", 25)
def bending_by_weight(seen: Evidence) -> str | None:
    """The mean quasi-static deflection is that of a beam on two pins under its weight."""
    beam, gravity = seen.scenario.payload, seen.scenario.gravity
    if seen.steady is None or gravity == 0 or beam.boundary != "pinned-pinned":
        return None
    span = (
        newest(seen.samples, max(seen.period, seen.scenario.trajectory.slowest_period)) if seen.moving else seen.steady
    )
    sag = 5 * beam.linear_density * gravity * beam.length**4 / (384 * beam.bending_stiffness)
    held = sag * float(np.mean(np.cos(span.desired_pose[:, 2])))
    mean = float(np.mean(span.quasi_static_deflection))
    if abs(mean + held) > AGREES * abs(held):
        return None
    return (
        f"The weight bends the beam by {length(abs(held))}, at rest as in motion, of {length(largest(span.midspan_deflection))} "
        f"in all; only {length(largest(span.vibration))} of that vibrate. No law can take the weight's part away."
    )
