"""A mode that the observer does not know, fed by what its gauges see of it."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register
from flexlab.analysis.explanations.growing_pole import fastest_growth, observer_of


@register(
    "spillover",
    "y = C_o z_o + C_r z_r: what gauges see of modes r outside the model enters the estimate of those in it (Balas 1978)",
    "Spectrum of the mid-span vibration",
    3,
)
def spillover(seen: Evidence) -> str | None:
    """The growing mode is none of those that are observed."""
    growth, observer = fastest_growth(seen.background), observer_of(seen.background)
    if growth is None or observer is None or growth.mode <= observer.observer_modes:
        return None
    period = seen.scenario.controller.control_period
    shown = abs(growth.frequency - round(growth.frequency * period) / period)
    folded = f", at {n(shown)} Hz with a clock of {n(1 / period)} Hz" if growth.frequency > 0.5 / period else ""
    more = 100 * growth.rate / (2 * np.pi * growth.frequency)
    return (
        f"Mode {growth.mode}, {n(growth.frequency)} Hz, grows at {n(growth.rate)} 1/s: the observer knows "
        f"{observer.observer_modes} modes, and the gauges see this one all the same{folded} (spillover). A damping ratio larger "
        f"by {n(more)} % or lower vibration gains help."
    )
