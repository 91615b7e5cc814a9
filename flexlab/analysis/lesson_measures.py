"""What lessons measure in a run: frequencies, peaks, jumps, how they read in a sentence, and what a check answers."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flexlab.analysis.metrics.run_metrics import between
from flexlab.scenario import Payload
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.build import build_beam
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import Event

UNDAMPED_TIME = 0.44
"""Settling time of the preset paper, s (a test measures it)."""
DISTURBANCES = (ChangeScenario, Pull, Tap)
"""Commands after which a run is not steady for a while."""


class Verdict(NamedTuple):
    """What a check found: whether the lesson is done, and a sentence with the numbers or the next step."""

    done: bool
    sentence: str


def has_start(samples: Samples) -> bool:
    """Whether the run's first instant is among them."""
    return bool(samples.time[0] < 0.5 * tick(samples))


def wait_for_start(samples: Samples, until: float) -> Verdict | None:
    """What to do while a check that looks at a run's start cannot be made; None when it can."""
    if not has_start(samples):
        return Verdict(False, "Press R: this check looks at the start of a run.")
    if samples.time[-1] < until:
        return Verdict(False, f"Let the run go on to t = {until:g} s.")
    return None


def changed(events: Sequence[Event]) -> bool:
    """Whether a run's scenario was changed on its way."""
    return any(isinstance(event.command, ChangeScenario) for event in events)


def first_frequency(payload: Payload) -> float:
    """f1 of the payload with its grips held, Hz."""
    return _first_frequency(payload.model_dump_json())


@lru_cache(maxsize=32)
def _first_frequency(payload: str) -> float:
    """Remembered, because the lab asks several times a second and 64 elements take a while."""
    with one_blas_thread():
        return float(np.min(build_beam(Payload.model_validate_json(payload)).modes.omega)) / (2 * np.pi)


def ring_frequency(samples: Samples) -> float:
    """The strongest frequency of the vibration above 2 Hz, Hz."""
    signal = samples.vibration
    padded = 1 << 15
    spectrum = np.abs(np.fft.rfft((signal - signal.mean()) * np.hanning(len(signal)), padded))
    hertz = np.fft.rfftfreq(padded, tick(samples))
    return float(hertz[np.argmax(np.where(hertz > 2, spectrum, 0))])


def torque_jump(samples: Samples, control_period: float) -> float:
    """RMS change of the joint torques over one control period, the largest of all joints, N·m."""
    stride = max(1, round(control_period / tick(samples)))
    torque = samples.joint_torque[::stride]
    return float(np.sqrt(np.mean(np.diff(torque, axis=0) ** 2, axis=0)).max()) if len(torque) > 1 else 0.0


def tick(samples: Samples) -> float:
    """The sample period, s; needs two samples or more."""
    return float(samples.time[-1] - samples.time[0]) / (len(samples) - 1)


def newest(samples: Samples, seconds: float) -> Samples:
    """The newest `seconds` of samples."""
    return between(samples, samples.time[-1] - seconds, samples.time[-1])


def largest(signal: np.ndarray) -> float:
    """The largest magnitude; 0 for nothing."""
    return float(np.abs(signal).max()) if signal.size else 0.0


def length(metres: float) -> str:
    """A length as it reads best: mm, or µm under 10 µm."""
    return f"{1e3 * metres:.2f} mm" if metres >= 1e-5 else f"{1e6 * metres:.1f} µm"
