"""A loop that little destroys, and a proof that says nothing."""

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register

SMALL = 30.0
"""Phase of all motors that counts as a small margin, °: textbooks ask for it."""

SLOWEST = 0.1
"""Hz; a memory that hardly moves has no phase to lose."""


@register("small margin", "α = 1/max ρ((S - T)/2), the disk margin of all motors alike", "Tracking error", 18)
def small_margin(seen: Evidence) -> str | None:
    """A stable loop whose motors may deviate by little."""
    found = seen.background.modes
    margin = found.disk_margin
    if margin is None or found.unstable or not 0 < margin.alike.alpha < 2 or margin.alike.phase >= SMALL:
        return None
    low, high = margin.alike.gain
    frequency = margin.alike.frequency
    if frequency < SLOWEST:
        return None
    late = 1e3 * margin.alike.phase / 360 / frequency
    return (
        f"The loop is nearly lost at {n(frequency)} Hz: it survives no more than a factor of {n(low)} to {n(high)} on all "
        f"motors, or ±{margin.alike.phase:.0f}°, which is {n(late)} ms there. Lower gains or less delay widen it."
    )


@register("condition not met", "the law's stability conditions, below its gains", "Sliding variable s", 40)
def condition_not_met(seen: Evidence) -> str | None:
    """The first condition that the scenario does not meet, of a loop whose poles nevertheless decay."""
    unmet = [condition for condition in seen.background.conditions if not condition.met]
    if not unmet or seen.background.modes.unstable:
        return None
    return f"The proof is silent here, as one of its conditions is not met: {unmet[0].sentence}"
