"""What a motion that has ended leaves behind, and what input shapers make of it."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence, Ring
from flexlab.analysis.explanations.explanation import n, register
from flexlab.analysis.lesson_measures import largest, length
from flexlab.analysis.metrics.residual_vibration import ResidualVibration
from flexlab.control.shapers import TOLERATED

WORTH = 1e-5
"""Vibration after the stop from which on it is worth a sentence, m."""
MISSED = TOLERATED + 0.01
"""Share left over from which on a shaper counts as tuned to another mode."""


def share_left(shaper: np.ndarray, ring: Ring) -> float:
    """Vibration of a mode after a shaper's impulses (k, 2), as a share of that after one impulse at their beginning, 1."""
    pole, (amplitude, time) = complex(ring.rate, 2 * np.pi * ring.frequency), shaper.T
    return float(abs(np.sum(amplitude * np.exp(-pole * time))))


def _left(seen: Evidence) -> float:
    """Largest vibration after the stop, m; NaN of a target that has not stopped within the samples."""
    metric = ResidualVibration()
    metric.update(seen.samples)
    return metric.compute()[0]


@register("left after the stop", "η(t) = Σ of the free answers to each jump of ẍ_d", "Mid-span deflection", 11)
def left_after_the_stop(seen: Evidence) -> str | None:
    """Without a shaper: what rings on, and what a shaper for that mode would cost."""
    left, ring = _left(seen), seen.background.rings.get(1)
    if not left > WORTH or ring is None or len(seen.background.shaper):
        return None
    return (
        f"After the stop the beam rings on by {length(left)}, {n(100 * left / seen.peak_vibration)} % of its largest vibration. "
        f"An input shaper for mode 1 ({n(ring.frequency)} Hz) ends the motion {n(500 / ring.frequency)} ms later (zv) and "
        "leaves nearly none."
    )


@register(
    "left after a shaped stop",
    "x_shaped(t) = Σ A_j x_d(t - t_j): vibration Σ A_j exp(iωt_j)",
    "Mid-span deflection",
    29,
)
def left_after_a_shaped_stop(seen: Evidence) -> str | None:
    """With a shaper that fits: what is left after it."""
    left, ring, shaper = _left(seen), seen.background.rings.get(1), seen.background.shaper
    if not np.isfinite(left) or ring is None or not len(shaper) or seen.peak_vibration < WORTH:
        return None
    share = share_left(shaper, ring)
    if share > MISSED or left > 0.2 * seen.peak_vibration:
        return None
    return (
        f"The shaper {seen.scenario.trajectory.shaper} ends the motion {n(1e3 * float(shaper[-1, 1]))} ms later; of up to "
        f"{length(seen.peak_vibration)} of vibration {length(left)} are left after the stop, as what one copy excites meets that "
        "of the next."
    )


@register("shaper for another mode", "|Σ A_j exp(iωt_j)| of the mode that rings", "Mid-span deflection", 9)
def shaper_for_another_mode(seen: Evidence) -> str | None:
    """The shaper's frequency is not the closed loop's: what it leaves by the formula."""
    shaper, ring = seen.background.shaper, seen.background.rings.get(1)
    if not len(shaper) or ring is None:
        return None
    share = share_left(shaper, ring)
    if share < MISSED:
        return None
    tuned = 0.5 / float(shaper[1, 1])
    peak = largest(seen.samples.vibration)
    return (
        f"The shaper {seen.scenario.trajectory.shaper} is made for {n(tuned)} Hz, but the loop rings at {n(ring.frequency)} Hz: "
        f"it leaves {n(100 * share)} % of the mode's vibration (so far {length(peak)} at most). No frequency (null) lets it "
        "follow the loop; zvd and ei-shaper forgive more."
    )
