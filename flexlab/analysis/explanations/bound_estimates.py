"""Bound estimates that drift under noise, and leakage that holds them."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register

WORTH = 1e-4
"""Growth of b̂_0 that is worth a sentence, N/s."""
STANDS = 0.05
"""Share of b̂_0 that it may change by within a second to count as standing."""
AGREES = 0.3
"""Relative difference up to which growth and fading balance."""


def _growth(seen: Evidence) -> tuple[float, float, float] | None:
    """b̂_0 now, N, its change, N/s, and k_0; None without estimates or steady motion."""
    adaptation = getattr(seen.scenario.controller, "adaptation", None)
    if adaptation is None or seen.steady is None or not np.isfinite(seen.steady.bound_estimates).all():
        return None
    estimate = seen.steady.bound_estimates[:, 0]
    span = float(seen.steady.time[-1] - seen.steady.time[0])
    return float(estimate[-1]), float(estimate[-1] - estimate[0]) / span, float(adaptation[0])


@register("drifting estimates", "ḃ_0 = ‖s‖/k_0 ≥ 0, Eq. (23)", "Bound estimates b̂", 16)
def drifting_estimates(seen: Evidence) -> str | None:
    """Noise keeps ‖s‖ from zero, so that estimates grow without need."""
    found, law = _growth(seen), seen.scenario.controller
    if found is None or law.leakage > 0 or not law.sensor_noise.active:
        return None
    now, rate, k0 = found
    if rate < WORTH:
        return None
    return (
        f"b̂0 = {n(now)} N grows by {n(rate)} N each second and never shrinks: noise keeps the measured ‖s‖ at "
        f"{n(rate * k0)} m/s. Leakage is the cure: σ = {n(rate / now)} 1/s would hold it where it is."
    )


@register("leaking estimates", "ḃ_0 = ‖s‖/k_0 - σ b̂_0 = 0 at b̂_0 = ‖s‖/(σ k_0)", "Bound estimates b̂", 28)
def leaking_estimates(seen: Evidence) -> str | None:
    """Leakage and growth balance: the estimate stands near ‖s‖/(σ k_0)."""
    found, law = _growth(seen), seen.scenario.controller
    if found is None or law.leakage <= 0 or seen.steady is None:
        return None
    now, rate, k0 = found
    size = float(np.mean(np.linalg.norm(seen.steady.sliding_variable, axis=1)))
    balance = size / (law.leakage * k0)
    if abs(rate) > STANDS * now or (not law.sensor_noise.active and abs(now / balance - 1) > AGREES):
        return None
    return (
        f"b̂0 stands at {n(now)} N instead of growing: leakage σ = {n(law.leakage)} 1/s takes from it what ‖s‖ adds, "
        f"{n(now * law.leakage)} N each second. A larger σ holds it lower, and forgets sooner what was learnt."
    )
