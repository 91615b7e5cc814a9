"""A free vibration: which mode rings, how fast it fades, and what takes its energy."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence, Ring
from flexlab.analysis.explanations.explanation import n, register
from flexlab.analysis.lesson_measures import largest, length, ring_frequency
from flexlab.sim.samples import Samples

RINGING = 2e-5
"""Vibration that counts as a ring, m."""
FADED = 0.03
"""Share of its peak down to which a ring is measured."""
FREQUENCY_AGREES, RATE_AGREES = 0.03, 0.3
"""Relative differences between run and pole up to which they are one ring."""
FEWEST_PERIODS = 4
DAMPED = 1.5
"""Times its own damping at which a mode counts as actively damped."""


def ringing_part(samples: Samples) -> Samples | None:
    """From the largest vibration until it has faded; None of one that does not fade, or is none."""
    size = np.abs(samples.vibration)
    peak = int(np.argmax(size))
    if size[peak] < RINGING:
        return None
    end = peak + int(np.flatnonzero(size[peak:] > FADED * size[peak])[-1]) + 1
    if end - peak < 16 or largest(samples.vibration[(peak + end) // 2 : end]) > 0.8 * size[peak]:
        return None
    return samples.slice(peak, end)


def fading_rate(samples: Samples, hertz: float) -> float:
    """d ln(amplitude)/dt of a ring, 1/s: through the largest magnitude of each of its periods; NaN of fewer than four."""
    count = int((samples.time[-1] - samples.time[0]) * hertz)
    if count < FEWEST_PERIODS:
        return float("nan")
    parts = np.array_split(np.arange(len(samples)), count)
    tops = [part[np.argmax(np.abs(samples.vibration[part]))] for part in parts]
    return float(np.polyfit(samples.time[tops], np.log(np.abs(samples.vibration[tops])), 1)[0])


@register("ring", "w ~ exp(-ζωt) cos(ωt): the pole -ζω ± iω of the closed loop", "Mid-span deflection", 20)
def ring(seen: Evidence) -> str | None:
    """Frequency and decay in the run agree with a mode's pole."""
    part = ringing_part(seen.samples)
    if part is None:
        return None
    hertz = ring_frequency(part)
    found = [(abs(each.frequency - hertz), number, each) for number, each in seen.background.rings.items()]
    if not found:
        return None
    away, number, mode = min(found)
    rate = fading_rate(part, hertz)
    if not (rate < 0 and mode.rate < 0):
        return None
    if away > max(FREQUENCY_AGREES * hertz, 1 / seen.length) or not abs(rate - mode.rate) < RATE_AGREES * abs(
        mode.rate
    ):
        return None
    peak = largest(part.vibration)
    return (
        f"From t = {part.time[0]:.2f} s on the beam rings at {n(hertz)} Hz by up to {length(peak)}: mode {number}, free, as it "
        f"fades at {n(-rate)} 1/s, to 1 % in {n(np.log(100) / -rate)} s{_by_what(seen, number, mode)}."
    )


def _by_what(seen: Evidence, number: int, mode: Ring) -> str:
    found = seen.background.modes
    own = 2 * np.pi * float(found.frequency[number - 1] * found.damping_ratio[number - 1])
    if -mode.rate > DAMPED * own:
        return f"; with its grips held it would fade at {n(own)} 1/s, so the law damps it"
    held = f"; with its grips held it would fade at {n(own)} 1/s"
    return (
        held
        if hasattr(seen.scenario.controller, "lateral_vibration_gain")
        else f"{held}. Active damping ends it sooner"
    )
