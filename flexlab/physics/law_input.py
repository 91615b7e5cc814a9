"""The input record of a control law at one instant, filled by the engine, with room for the law's answer.

The engine keeps two: one for the true state, one for what a sampled controller measures.
"""

import numpy as np

MOST_ARMS = 2
MOST_GAUGES = 8
"""Most strain gauges that a law may read."""
MOST_DELAY = 64
"""Longest input delay, samples: the most torques under way."""
LAW_INPUT = np.dtype(
    [
        ("arm_count", "i8"),
        ("time", "f8"),
        ("x", "f8", (3,)),
        ("v", "f8", (3,)),
        ("beam_rate", "f8", (2,)),
        ("gauge_count", "i8"),
        ("strain", "f8", (MOST_GAUGES,)),
        ("delay", "i8"),
        ("torque", "f8", (MOST_DELAY + 1, MOST_ARMS, 3)),
        ("desired", "f8", (3, 3)),
        ("coming", "f8", (3, 3)),
        ("trig", "f8", (2,)),
        ("M", "f8", (MOST_ARMS, 3, 3)),
        ("C", "f8", (MOST_ARMS, 3, 3)),
        ("G", "f8", (MOST_ARMS, 3)),
        ("J", "f8", (MOST_ARMS, 2, 3)),
        ("direction", "f8", (MOST_ARMS, 4)),
        ("gravity", "f8"),
        ("m", "f8"),
        ("I", "f8"),
        ("kappa", "f8", (3,)),
        ("growth", "f8"),
        ("share", "f8", (MOST_ARMS,)),
        ("scratch", "f8", (8, 3)),
        ("u", "f8", (MOST_ARMS, 3)),
    ],
    align=True,
)
"""`arm_count`: number of arms. `time`: t, s. `x`, `v`: pose and its rate. `beam_rate`: hᵀq̇, gᵀq̇, kg·m/s, kg·m²/s.
`strain`: -½ t w''(s_j) at the law's `gauge_count` gauges, 1. `torque`: joint torques, N·m: [0] those held until now, then
those under way, the `delay` that act in the coming periods in this order. A continuous law has no gauges and no delay.
`desired`: x_d, ẋ_d, ẍ_d; `coming`: the same when the torques asked for now begin to act, for a sampled law.
`trig`: cos θ, sin θ. `M`, `C`, `G`, `J`, `direction`: M̄_i, C̄_i, Ḡ_i and more of `arm.ArmTerms`.
`gravity`: m/s², along -y. `m` (kg), `I` (kg·m²), `kappa` (hᵀM_q⁻¹h, hᵀM_q⁻¹g, gᵀM_q⁻¹g): the payload as the controller
believes it to be at this instant, `growth` its ṁ/m, 1/s. `share`: each arm's share of the common part, 1. `scratch`: free
for the law. `u`: the law's answer, u_i, N, N, N·m."""


def make_law_input(arm_count: int) -> np.ndarray:
    """One record (1,) for `arm_count` arms."""
    record = np.zeros(1, LAW_INPUT)
    record["arm_count"] = arm_count
    return record.view(np.recarray)
