"""The one seam between the engine and every control law: state and plant terms in, arm inputs and memory rates out.

A law is chosen by number, not passed as a function: compiled code that takes functions could not be cached, and changing
the law of a running lab would compile anew.
"""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import inlined
from flexlab.control.adaptive_sliding_mode import AdaptiveGains, adaptive_sliding_mode
from flexlab.control.computed_torque import computed_torque
from flexlab.control.load_sharing import BelievedPayload
from flexlab.control.proportional_derivative import FeedbackGains, proportional_derivative
from flexlab.control.vibration_damping import add_vibration_damping

NONE, ADAPTIVE_SLIDING_MODE, COMPUTED_TORQUE, PROPORTIONAL_DERIVATIVE, VIBRATION_DAMPING = range(5)


class Control(NamedTuple):
    """A control law with its gains, and how its inputs and outputs reach the plant."""

    kind: int
    adaptive: AdaptiveGains
    feedback: FeedbackGains
    vibration_gains: np.ndarray
    """k_v, k_θ of `vibration_damping`, (2,)."""
    payload: BelievedPayload
    torque_limit: np.ndarray
    """N·m per joint, infinite where there is none, (3,)."""
    limited: bool
    sampled: bool
    """Zero-order hold: the inputs are computed by `sim.sampled_control` at the control instants only."""
    scratch: np.ndarray
    """(6, 3)."""


@inlined
def control_law(control, gravity, x, v, beam_rate, terms, desired, memory, u, memory_rate):
    """Fill u (arms, 3) and the memory's rates (3,) for the pose x, its rate v, hᵀq̇ and gᵀq̇ in beam_rate (2,)."""
    kind = control.kind
    for a in range(3):
        memory_rate[a] = 0.0
    if kind == ADAPTIVE_SLIDING_MODE or kind == VIBRATION_DAMPING:
        adaptive_sliding_mode(
            control.adaptive, control.payload, gravity, x, v, terms, desired, memory, control.scratch, u, memory_rate
        )
        if kind == VIBRATION_DAMPING:
            add_vibration_damping(control.vibration_gains, terms, beam_rate, u)
    elif kind == COMPUTED_TORQUE:
        computed_torque(control.feedback, control.payload, gravity, x, v, terms, desired, control.scratch, u)
    elif kind == PROPORTIONAL_DERIVATIVE:
        proportional_derivative(control.feedback, control.payload, gravity, x, v, terms, desired, u)
    else:
        for i in range(len(u)):
            for a in range(3):
                u[i, a] = 0.0
