"""A mode that is too fast for the samples, and shows at a frequency that nothing moves at."""

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register

LEAST = 1e-8
"""Amplitude below which nothing is worth a name, m."""
NEAR = 0.02
"""Relative distance of frequencies that count as one."""


@register(
    "folded mode",
    "f_shown = |f - round(f T) / T| with T the time between samples (Nyquist: f < 1/(2T))",
    "Spectrum of the mid-span vibration",
    30,
)
def folded_mode(seen: Evidence) -> str | None:
    """The strongest line of the spectrum is where a mode above half the sampling rate folds to, and no mode below it is."""
    (hertz, amplitude), rate = seen.strongest, 1 / seen.period
    if amplitude < LEAST or any(abs(ring.frequency - hertz) < NEAR * hertz for ring in seen.background.rings.values()):
        return None
    fast = [(number, ring) for number, ring in seen.background.rings.items() if ring.frequency > rate / 2]
    shown = {number: abs(ring.frequency - round(ring.frequency / rate) * rate) for number, ring in fast}
    near = [(number, ring) for number, ring in fast if abs(shown[number] - hertz) < max(NEAR * hertz, 2 / seen.length)]
    if len(near) != 1:
        return None
    ((number, ring),) = near
    return (
        f"The {n(hertz)} Hz of the spectrum are mode {number} at {n(ring.frequency)} Hz: samples come every "
        f"{n(1e3 * seen.period)} ms, and what is faster than {n(rate / 2)} Hz folds down. Nothing moves at {n(hertz)} "
        "Hz; a run with a shorter sample period shows it as it is."
    )
