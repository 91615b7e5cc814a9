"""A squeeze that was asked for."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register

AGREES = 0.1
"""Share of the wanted force by which the mean may differ from it."""
CANCELLED = 1e-6
"""N and N·m: rounding."""


@register("wanted force", "u_1 += F_d (cos θ, sin θ, 0), u_2 -= the same: F_1 + F_2 = 0", "Internal force", 27)
def wanted_force(seen: Evidence) -> str | None:
    """The internal force along the link is, on average, the wanted one."""
    span, wanted = seen.steady, seen.scenario.controller.wanted_internal_force
    if span is None or wanted == 0 or len(seen.scenario.arms) < 2:
        return None
    angle, force = span.pose[:, 2], span.internal_force
    along = force[:, 0, 0] * np.cos(angle) + force[:, 0, 1] * np.sin(angle)
    if abs(float(along.mean()) - wanted) > AGREES * abs(wanted) or np.abs(force.sum(axis=1)).max() > CANCELLED:
        return None
    return (
        f"The arms squeeze the payload with {n(float(along.mean()))} N along the link because F_d = {n(wanted)} N is wanted; it "
        "moves nothing, as the two internal forces cancel."
    )
