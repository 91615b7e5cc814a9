"""An arm that is nearly stretched or folded."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register
from flexlab.analysis.lesson_measures import largest
from flexlab.sim.termination import arm_name, elbow_sine, wrist_reach

NEAR = 0.3
"""Sine of the elbow angle below which an arm counts as nearly singular: 17° from straight."""


@register("nearly singular arm", "det J_i = l_1 l_2 sin θ_2, Eq. (12)", "Joint torques", 12)
def nearly_singular_arm(seen: Evidence) -> str | None:
    """The arm whose elbow came closest to straight in the newest second."""
    found = []
    for index, arm in enumerate(seen.scenario.arms):
        reach, _, _ = wrist_reach(seen.scenario, index, seen.last_second.pose)
        found.append((float(np.min(elbow_sine(reach, arm.link_length[0], arm.link_length[1]))), index, reach))
    sine, index, reach = min(found, key=lambda one: one[0])
    if sine >= NEAR:
        return None
    l1, l2, _ = seen.scenario.arms[index].link_length
    posture = "stretched" if float(np.max(reach)) > np.hypot(l1, l2) else "folded"
    torque = largest(seen.last_second.joint_torque[:, index])
    return (
        f"The elbow of the {arm_name(seen.scenario, index)} comes within {n(np.degrees(np.arcsin(sine)))}° of {posture}: there "
        f"joint rates grow as 1/sin θ2 = {n(1 / max(sine, 1e-6))}, and its torques reach {n(torque)} N·m. A smaller path, or one "
        "nearer to the bases' middle, helps."
    )
