"""What lessons measure in a run: frequencies, peaks, jumps, and how they read in a sentence."""

from functools import lru_cache

import numpy as np

from flexlab.analysis.metrics.run_metrics import between
from flexlab.scenario import Payload
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.build import build_beam
from flexlab.sim.samples import Samples


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
