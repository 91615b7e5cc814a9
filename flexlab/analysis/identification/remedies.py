"""Remedies for a fitted ring: an input shaper and a vibration gain."""

import math
from typing import NamedTuple

import numpy as np

from flexlab.analysis.identification.estimates import RingFit
from flexlab.control.motion import impulses, residual
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam

SHAPERS = ("zv", "zvd", "ei-shaper")
"""Shortest first."""
TOLERATED = 0.0501
"""Largest residual vibration of a suitable shaper, as a share of the unshaped: 5 % and rounding error."""
WIDEST, STEPS = 0.5, 1001
"""Largest relative error of the frequency in the search for a shaper's band, and number of its steps."""
WANTED_RATIO = 0.1
"""Damping ratio under the suggested gain; the mode then decays to 1 % within seven and a half periods."""
SEEN = 0.01
"""Least share of a mode in the loads of a motion for which that motion can damp the mode."""


class ShaperChoice(NamedTuple):
    """One input shaper for a ring."""

    name: str
    delay: float
    """How much later the motion ends, s."""
    band: float
    """Largest relative error of the frequency, either way, with which less than 5 % of the vibration remains."""


class Remedies(NamedTuple):
    """The remedies for a ring."""

    shapers: tuple[ShaperChoice, ...]
    suggested: str
    """The shortest shaper whose band holds the frequency's 95 % interval."""
    frequency: float
    """Hz."""
    damping_ratio: float
    gain_field: str
    """Name of the gain that damps this mode."""
    gain: float
    """Value of that gain with which the damping ratio is `WANTED_RATIO`."""

    def changes(self, shaper: str) -> dict[str, object]:
        """The changes that put a shaper for this ring into a scenario's path."""
        return {
            "trajectory.shaper": shaper,
            "trajectory.shaper_frequency": self.frequency,
            "trajectory.shaper_damping": self.damping_ratio,
        }


def remedies(fit: RingFit, scenario: Scenario) -> Remedies | None:
    """The remedies for the loudest mode; None if its frequency is not identifiable.

    The gain is k_v of a_lat = k_v hᵀq̇ (or k_θ of α = k_θ gᵀq̇), which adds k_v h_k²/(2 ω_k) to the damping ratio of mode k if
    torques act without delay.
    """
    frequency, ratio = fit.first.frequency, fit.first.damping_ratio
    if not frequency.identifiable:
        return None
    omega = 2 * math.pi * frequency.value
    zeta = float(np.clip(ratio.value, 0.0, 0.9)) if ratio.identifiable else 0.0
    uncertain = max(frequency.high - frequency.value, frequency.value - frequency.low) / frequency.value
    choices = tuple(_choice(name, omega, zeta) for name in SHAPERS)
    suggested = next((choice.name for choice in choices if choice.band >= uncertain), SHAPERS[-1])
    beam = build_beam(scenario.payload)
    mode = int(np.argmin(np.abs(beam.modes.omega - omega)))
    h, g = (float(beam.modes.V[:, mode] @ load) for load in (beam.matrices.h, beam.matrices.g))
    lateral = h * h > SEEN * beam.kappa[0]
    square, field = (h * h, "lateral_vibration_gain") if lateral else (g * g, "angular_vibration_gain")
    gain = max(0.0, 2 * (WANTED_RATIO - zeta) * omega / square) if square > 0 else math.nan
    return Remedies(choices, suggested, frequency.value, zeta, field, gain)


def _choice(name: str, omega: float, zeta: float) -> ShaperChoice:
    shaped = impulses(name, omega, zeta)
    undamped = impulses(name, omega, 0.0)
    off = np.linspace(0.0, WIDEST, STEPS)
    left = np.array([max(residual(undamped, omega * (1 + d)), residual(undamped, omega * (1 - d))) for d in off])
    wrong = np.flatnonzero(left > TOLERATED)
    return ShaperChoice(name, float(shaped[-1, 1]), float(off[wrong[0] - 1] if len(wrong) else WIDEST))
