"""Torques that follow the sensors' noise."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register
from flexlab.analysis.lesson_measures import torque_jump

LEAST = 1.0
"""RMS jump of a joint torque per control step that is worth a word, N·m."""
WHITE = -0.3
"""Correlation of one jump with the next, from which on downwards they are noise: -½ of a white signal's differences."""


@register("noisy torques", "τ = 𝒥⁻ᵀu(x + n_x, ẋ + n_v): noise times gain", "Joint torques", 14)
def noisy_torques(seen: Evidence) -> str | None:
    """Torques change at random from instant to instant, and sensors are noisy."""
    law = seen.scenario.controller
    if law.control_period is None or not law.sensor_noise.active:
        return None
    span, stride = seen.last_second, max(1, round(law.control_period / seen.period))
    jump = torque_jump(span, law.control_period)
    turns = np.diff(span.joint_torque[::stride].reshape(len(span.time[::stride]), -1), axis=0)
    if jump < LEAST or len(turns) < 32:
        return None
    likeness = float(np.sum(turns[1:] * turns[:-1]) / np.sum(turns**2))
    if likeness > WHITE:
        return None
    return (
        f"The torques jump by {n(jump)} N·m (RMS) from one control instant to the next, at random (each jump is followed by its "
        f"opposite, correlation {n(likeness)}): that is the sensors' noise times the gains. Better sensors, lower gains or an "
        "observer calm them."
    )
