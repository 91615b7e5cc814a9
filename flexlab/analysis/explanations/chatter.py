"""Torques that jump to and fro at every control instant."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register
from flexlab.analysis.lesson_measures import torque_jump

CHATTER = 5.0
"""RMS jump of a joint torque from one control step to the next that counts as chatter, N·m; 0.5 is usual."""


@register("chatter", "ū_3 = -Ψ s / max(‖s‖, ε), Eq. (25): s crosses ε within a control period", "Joint torques", 6)
def chatter(seen: Evidence) -> str | None:
    """Torques alternate from instant to instant, and s moves by its boundary layer or more within one."""
    law, layer = seen.scenario.controller, seen.field("boundary_layer")
    if law.control_period is None or layer is None or law.sensor_noise.active:
        return None
    span, stride = seen.last_second, max(1, round(law.control_period / seen.period))
    jump = torque_jump(span, law.control_period)
    turns = np.diff(span.joint_torque[::stride].reshape(len(span.time[::stride]), -1), axis=0)
    step = np.linalg.norm(np.diff(span.sliding_variable[::stride], axis=0), axis=1)
    if jump < CHATTER or len(turns) < 8 or float(np.median(step)) < layer:
        return None
    if float(np.sum(turns[1:] * turns[:-1])) >= 0:
        return None
    return (
        f"The torques chatter, by {n(jump)} N·m (RMS over the last second) at each instant of the "
        f"{n(1e3 * law.control_period)} ms clock: within one, s moves by {n(float(np.median(step)))} m/s, more than its "
        f"boundary layer of {n(layer)} m/s, so that every step overshoots. A thicker layer or a shorter control period calms "
        f"them."
    )
