"""The samples in which a run rings freely: after a tap, a release or a stop, until the next change of the run."""

from collections.abc import Sequence

import numpy as np

from flexlab.analysis.identification.evidence import ring_begins
from flexlab.analysis.metrics.vibration import ResidualVibration
from flexlab.errors import StudyError
from flexlab.recording.course import is_pulled
from flexlab.recording.reader import Recording
from flexlab.sim.commands import Pull, Tap, WorldCommand
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
    later = [event.time for event in events if isinstance(event.command, WorldCommand) and event.time > first]
    last = end if end is not None else min([*later, first + LONGEST_RING, float(samples.time[-1])])
    rows = (samples.time > first) & (samples.time <= last)
    time, signal = samples.time[rows], np.asarray(samples[name])[rows]
    if end is None and len(time):
        # After the ring the motion bends the beam, which is not part of the model.
        loud = np.flatnonzero(np.abs(signal) > GONE * np.abs(signal).max())
        stop = int(loud[-1]) + 1 if len(loud) else 0
        time, signal = time[:stop], signal[:stop]
    return time, signal
