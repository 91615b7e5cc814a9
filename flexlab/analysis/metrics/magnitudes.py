"""Magnitudes of signals: root mean squares and peaks, and the duration over which they are taken."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.metrics.metric import Column, Metric, Peak, RootMeanSquare, of_signal, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


@register
class Duration(Metric):
    """From the first sample to the last, s; 0 without samples."""

    name, place = "duration", 0
    columns = (Column("window", "Duration", "duration", "s"),)

    def __init__(self) -> None:
        self._first, self._last = np.inf, -np.inf

    def update(self, samples: "Samples") -> None:
        """Take in the next piece of a run."""
        self._first = min(self._first, float(samples.time[0]))
        self._last = max(self._last, float(samples.time[-1]))

    def compute(self) -> tuple[float, ...]:
        """Seconds."""
        return (self._last - self._first if self._last >= self._first else 0.0,)


@register
@of_signal(
    RootMeanSquare,
    10,
    Column("rms-x", "RMS error x", "RMS x", "mm", 1e3, listed=True, part="x"),
    Column("rms-y", "RMS error y", "RMS y", "mm", 1e3, listed=True, part="y"),
    Column("rms-theta", "RMS error θ", "RMS θ", "mrad", 1e3, part="theta"),
)
def rms_error(samples: "Samples") -> np.ndarray:
    """Root mean square of e = x - x_d, m, m, rad."""
    return samples.tracking_error


@register
@of_signal(RootMeanSquare, 60, Column("force", "RMS internal force", "RMS force", "N", listed=True))
def rms_internal_force(samples: "Samples") -> np.ndarray:
    """Root mean square of the (x, y) part of the left arm's internal force, N."""
    return np.hypot(samples.internal_force[:, 0, 0], samples.internal_force[:, 0, 1])[:, None]


@register
@of_signal(RootMeanSquare, 61, Column("moment", "RMS internal moment", "RMS moment", "N·m"))
def rms_internal_moment(samples: "Samples") -> np.ndarray:
    """Root mean square of the left arm's internal moment, N·m."""
    return samples.internal_force[:, 0, 2:]


@register
@of_signal(
    Peak,
    20,
    Column("peak-x", "Peak error x", "peak x", "mm", 1e3, part="x"),
    Column("peak-y", "Peak error y", "peak y", "mm", 1e3, part="y"),
    Column("peak-theta", "Peak error θ", "peak θ", "mrad", 1e3, part="theta"),
)
def peak_error(samples: "Samples") -> np.ndarray:
    """Largest |e|, m, m, rad."""
    return samples.tracking_error


@register
@of_signal(Peak, 30, Column("vibration", "Peak vibration", "vibration", "mm", 1e3, listed=True))
def peak_vibration(samples: "Samples") -> np.ndarray:
    """Largest magnitude of the mid-span deflection less its quasi-static part, m."""
    return samples.vibration[:, None]


@register
@of_signal(Peak, 47, Column("axial", "Peak compression of P_cr", "compression", "%", scale=100.0))
def peak_axial_load(samples: "Samples") -> np.ndarray:
    """Largest compression of the beam as a share of its buckling load."""
    return np.asarray(samples.axial_load_share)[:, None]


@register
@of_signal(Peak, 50, Column("torque", "Peak joint torque", "torque", "N·m", listed=True))
def peak_torque(samples: "Samples") -> np.ndarray:
    """Largest magnitude of any joint's torque, N·m."""
    return samples.joint_torque[:, None]
