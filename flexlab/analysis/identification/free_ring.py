"""The samples in which a run rings freely (after a tap, a release or a stop, until the next change), and a ring's remedies."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlab.analysis.identification.estimates import RingFit
from flexlab.analysis.identification.evidence import ring_begins
from flexlab.analysis.metrics.vibration import ResidualVibration
from flexlab.control.motion import impulses, residual
from flexlab.errors import StudyError
from flexlab.recording.course import DISTURBANCES, is_pulled
from flexlab.recording.reader import Recording
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.commands import Pull, Tap
from flexlab.sim.samples import Samples
from flexlab.sim.signals import DERIVED, TABLE
from flexlab.sim.snapshot import Event

LONGEST_RING = 2.0
"""Longest ring that is fitted, s."""
GONE = 0.005
"""Amplitude, over the peak, at which a fitted ring ends."""


def ring_of_run(
    recording: Recording, name: str = "vibration", start: float | None = None, end: float | None = None
) -> tuple[np.ndarray, np.ndarray, str]:
    """(time s, signal, unit) of a free ring up to `end`, s (None: of the run, or where it has faded). Raises `StudyError`.

    `start`, s; None: after the last tap before the end, or from the ring's beginning.
    """
    about = {**TABLE, **DERIVED}.get(name)
    if about is None or about.axes:
        usable = [other for other, signal in {**TABLE, **DERIVED}.items() if not signal.axes and other != "time"]
        raise StudyError(f"{name!r:.60} is not a signal that rings: choose one of {', '.join(usable)}.")
    samples = recording.samples
    if len(samples) == 0:
        raise StudyError(f"{recording.path.stem} has no samples.")
    whole, until = np.asarray(samples[name], float), np.inf if end is None else end
    if not np.isfinite(whole).all():
        raise StudyError(f"{recording.path.stem} was not recorded with {name} in all samples: choose another signal.")
    taps = [event.time for event in recording.events if isinstance(event.command, Tap) and event.time < until]
    if start is None:
        start = taps[-1] if taps else float(samples.time[ring_begins(whole[samples.time <= until])])
    time, signal = _ring(samples, recording.events, name, start, end)
    if not len(time):
        raise StudyError(f"{recording.path.stem} has no samples after {start:g} s in which it rings freely.")
    return time, signal, about.units[0]


def recent_ring(samples: Samples, events: Sequence[Event]) -> tuple[np.ndarray, np.ndarray, str]:
    """(time s, vibration m, what it follows) of the newest free ring in a running lab. Raises `StudyError` if there is none."""
    if is_pulled(events):
        raise StudyError("Somebody holds the machine: let go, and the ring that follows can be fitted.")
    begins = [(event.time, "the tap") for event in events if isinstance(event.command, Tap)]
    begins += [(event.time, "the release") for event in events if isinstance(event.command, Pull)]
    motion = ResidualVibration()
    if len(samples):
        motion.update(samples)
    begins.append((motion.stop, "the stop"))
    begins = [begin for begin in begins if len(samples) and begin[0] >= samples.time[0]]
    if not begins:
        raise StudyError("There is no free ring to fit: tap the beam, or let a path that ends come to rest.")
    first, what = max(begins)
    time, signal = _ring(samples, events, "vibration", first, None)
    if not len(time):
        raise StudyError(f"There are no samples since {what} at t = {first:.3f} s: let the run go on for a moment.")
    return time, signal, f"{what} at t = {first:.3f} s"


def _ring(
    samples: Samples, events: Sequence[Event], name: str, first: float, end: float | None
) -> tuple[np.ndarray, np.ndarray]:
    """Time and signal from `first`, s, until the next change of the run."""
    later = [event.time for event in events if isinstance(event.command, DISTURBANCES) and event.time > first]
    last = end if end is not None else min([*later, first + LONGEST_RING, float(samples.time[-1])])
    rows = (samples.time > first) & (samples.time <= last)
    time, signal = samples.time[rows], np.asarray(samples[name])[rows]
    if end is None and len(time):
        # After the ring the motion bends the beam, which is not part of the model.
        loud = np.flatnonzero(np.abs(signal) > GONE * np.abs(signal).max())
        stop = int(loud[-1]) + 1 if len(loud) else 0
        time, signal = time[:stop], signal[:stop]
    return time, signal


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
