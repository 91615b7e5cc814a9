"""The free ring in a recorded run: after its last tap, pull or change, until something else happens or it is gone."""

import numpy as np

from flexlab.errors import StudyError
from flexlab.recording.reader import Recording
from flexlab.sim.commands import Tap
from flexlab.sim.signals import DERIVED, TABLE

LONGEST_RING = 2.0
"""s: a longer one adds nothing to a fit."""
GONE = 0.005
"""Part of its peak at which a ring has gone in what else there is."""


def ring_of_run(
    recording: Recording, name: str = "vibration", start: float | None = None, end: float | None = None
) -> tuple[np.ndarray, np.ndarray, str]:
    """(time s, signal, unit) of the free ring; `start` None: after the last tap, or the run's start. Raises `StudyError`."""
    about = {**TABLE, **DERIVED}.get(name)
    if about is None or about.axes:
        usable = [other for other, signal in {**TABLE, **DERIVED}.items() if not signal.axes and other != "time"]
        raise StudyError(f"{name!r:.60} is no signal that rings: choose one of {', '.join(usable)}.")
    samples = recording.samples
    if len(samples) == 0:
        raise StudyError(f"{recording.path.stem} has no samples.")
    taps = [event.time for event in recording.events if isinstance(event.command, Tap)]
    first = start if start is not None else taps[-1] if taps else float(samples.time[0])
    later = [event.time for event in recording.events if event.command is not None and event.time > first]
    last = end if end is not None else min([*later, first + LONGEST_RING, float(samples.time[-1])])
    rows = (samples.time > first) & (samples.time <= last)
    if not rows.any():
        raise StudyError(f"{recording.path.stem} has no samples from {first:g} to {last:g} s.")
    time, signal = samples.time[rows], np.asarray(samples[name])[rows]
    if end is None:
        # What comes after the ring is the motion's own bending, which the model of a ring does not know.
        loud = np.flatnonzero(np.abs(signal) > GONE * np.abs(signal).max())
        stop = int(loud[-1]) + 1
        time, signal = time[:stop], signal[:stop]
    return time, signal, about.units[0]
