"""Where the force with which the arms press against each other comes from."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register

AGREES = 0.5
"""Share of the internal force, RMS, that its explanation may leave over."""


@register("load share", "F_1 = (α - ½) f + what the postures differ by, Eqs. (14), (15)", "Internal force", 26)
def load_share(seen: Evidence) -> str | None:
    """An uneven share of what moves the payload makes most of the internal force."""
    span, share = seen.steady, seen.scenario.controller.load_share
    if span is None or share == 0.5 or len(seen.scenario.arms) < 2 or seen.scenario.controller.wanted_internal_force:
        return None
    force = span.internal_force[:, 0, :2]
    predicted = (share - 0.5) * 2 * span.moving_force[:, :2]
    size, rest = (float(np.sqrt(np.mean(np.sum(part**2, axis=1)))) for part in (force, force - predicted))
    made = float(np.sqrt(np.mean(np.sum(predicted**2, axis=1))))
    if rest > AGREES * size:
        return None
    return (
        f"The arms press against each other with {n(size)} N (RMS), and {n(made)} N of it is the load share: the left arm gives "
        f"{n(100 * share)} % of what moves the payload. α = 0.5 takes that away and changes no motion."
    )
