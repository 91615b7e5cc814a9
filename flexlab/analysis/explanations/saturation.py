"""Motors at their limits."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register
from flexlab.analysis.lesson_measures import largest, length

AT_LIMIT = 1 - 1e-6
LEAST_SHARE = 0.005
"""Of the newest second: less is a passing touch."""
NAMES = ("left", "right")


@register("torque at its limit", "|τ_k| ≤ τ_max,k", "Joint torques", 5)
def torque_at_its_limit(seen: Evidence) -> str | None:
    """The joint that stands longest at its limit."""
    limit = seen.scenario.controller.torque_limit
    if limit is None:
        return None
    span = seen.last_second
    share = np.mean(np.abs(span.joint_torque) >= AT_LIMIT * np.array(limit), axis=0)
    arm, joint = np.unravel_index(int(np.argmax(share)), share.shape)
    if share[arm, joint] < LEAST_SHARE:
        return None
    return (
        f"Joint {joint + 1} of the {NAMES[arm]} arm stands at its limit of {n(limit[joint])} N·m for "
        f"{n(100 * float(share[arm, joint]))} % of the last {n(min(seen.length, 1.0))} s: the law has no say left there, and the "
        f"error reaches {length(largest(span.tracking_error[:, :2]))}. A slower path, a smooth start or a higher limit helps."
    )
