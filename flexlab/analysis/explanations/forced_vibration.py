"""Vibration that the path keeps up: of a soft beam, and at resonance."""

import numpy as np

from flexlab.analysis.explanations.evidence import Evidence
from flexlab.analysis.explanations.explanation import n, register
from flexlab.analysis.explanations.ring_decay import RINGING
from flexlab.analysis.lesson_measures import largest, length, newest

REPEATS = 0.05
"""Relative difference of two periods that count as the same."""
WORTH = 0.02
"""Share of the bending from which on it is worth a sentence."""
FOLLOWS = 0.2
"""Error, as a share of the way, up to which the payload follows its path."""
CLOSE = (0.6, 1.5)
"""Frequencies of a path over a mode's at which it is called resonance."""
AGREES = 0.35
"""Relative difference up to which the measured amplification is the formula's."""


def _two_periods(seen: Evidence) -> tuple[np.ndarray, np.ndarray] | None:
    """Vibration of the last period of the path and of the one before; None where there are not two of steady motion."""
    period = seen.scenario.trajectory.slowest_period
    count = round(period / seen.period)
    steps, motion = seen.samples.vibration, seen.last_second
    # A payload that does not follow its path does not bend as the path's acceleration would have it.
    if largest(motion.tracking_error[:, :2]) > FOLLOWS * float(np.ptp(motion.desired_pose[:, :2], axis=0).max()):
        return None
    if not seen.moving or count < 16 or 2 * period > seen.length + 1e-9 or len(steps) < 2 * count:
        return None
    return steps[-count:], steps[-2 * count : -count]


@register("resonance", "|w|/|w_qs| = 1/√((1 - r²)² + (2ζr)²), r = f_path/f_k", "Mid-span deflection", 10)
def resonance(seen: Evidence) -> str | None:
    """A sine near a mode of the loop, amplified as the formula says."""
    path, ring = seen.scenario.trajectory, seen.background.rings.get(1)
    pair = _two_periods(seen)
    if pair is None or ring is None or not hasattr(path, "amplitude") or not hasattr(path, "frequency"):
        return None
    amplitude, hertz = np.broadcast_to(path.amplitude, 3), np.broadcast_to(path.frequency, 3)
    r = float(hertz[np.argmax(np.abs(amplitude[:2]))]) / ring.frequency
    zeta = -ring.rate / (2 * np.pi * ring.frequency)
    ideal = 1 / np.hypot(1 - r * r, 2 * zeta * r)
    span = newest(seen.samples, path.slowest_period)
    bent, quasi = largest(span.midspan_deflection), largest(span.quasi_static_deflection)
    if not CLOSE[0] < r < CLOSE[1] or quasi < 1e-6 or abs(bent / quasi / ideal - 1) > AGREES:
        return None
    return (
        f"The path's {n(r * ring.frequency)} Hz are {n(r)} times mode 1 ({n(ring.frequency)} Hz): the beam "
        f"bends by {length(bent)}, {n(bent / quasi)} times what the same motion would hold slowly (resonance "
        f"of one mode: {n(ideal)} times). Another frequency of the path, a stiffer beam or active damping helps."
    )


@register(
    "forced vibration",
    "|w|/|w_qs| - 1 ≈ r², r = f_path/f_1: forced, at the path's own period",
    "Mid-span deflection",
    21,
)
def forced_vibration(seen: Evidence) -> str | None:
    """Vibration that repeats itself period by period."""
    pair, ring = _two_periods(seen), seen.background.rings.get(1)
    if pair is None or ring is None:
        return None
    peak, bending = largest(pair[0]), largest(seen.last_second.quasi_static_deflection)
    period = seen.scenario.trajectory.slowest_period
    if peak < max(RINGING, WORTH * bending) or largest(pair[0] - pair[1]) > REPEATS * peak:
        return None
    if ring.frequency * period < 1 / CLOSE[0] or resonance(seen):
        return None
    return (
        f"{length(peak)} of vibration repeat with the path's period of {n(period)} s: forced, no free ring, as mode 1 "
        f"({n(ring.frequency)} Hz) is only {n(ring.frequency * period)} times as fast. No damping ends it; a slower path or a "
        "stiffer beam makes it smaller."
    )
