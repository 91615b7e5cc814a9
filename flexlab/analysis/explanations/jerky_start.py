"""A start that has another velocity than its path."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register
from flexlab.analysis.explanations.ring_decay import RINGING
from flexlab.analysis.lesson_measures import largest, length
from flexlab.analysis.metrics.run_metrics import between

LEAST_JUMP = 0.1
"""m/s."""
FIRST = 0.1
"""s in which the start's own vibration peaks."""


@register("jerky start", "η̈ + Dη̇ + Ω²η = -h a⊥ - g θ̈, Eq. (10): a jump of ẋ is a burst of a", "Mid-span deflection", 22)
def jerky_start(seen: Evidence) -> str | None:
    """The run's first samples differ from the path's velocity, and its largest vibration follows at once."""
    samples = seen.samples
    if not seen.begins or seen.length < FIRST:
        return None
    path_rate = (samples.desired_pose[1] - samples.desired_pose[0]) / seen.period
    jump = float(np.linalg.norm((path_rate - samples.pose_rate[0])[:2]))
    start = float(samples.time[0])
    peak = largest(between(samples, start, start + FIRST).vibration)
    if jump < LEAST_JUMP or peak < RINGING or peak < seen.peak_vibration:
        return None
    return (
        f"The run starts with a velocity that is wrong by {n(jump)} m/s: to make up for it bends the beam by {length(peak)} "
        f"within {n(FIRST)} s. A smooth start, or one with the path's velocity, leaves it still."
    )
