"""How large signals are: root mean squares and largest magnitudes, and the duration that they speak of."""

from typing import TYPE_CHECKING, Self

import numpy as np

from flexlab.analysis.metrics.metric import Column, Metric, Peak, RootMeanSquare, register

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
        """Take in a piece of a run."""
        self._first = min(self._first, float(samples.time[0]))
        self._last = max(self._last, float(samples.time[-1]))

    def merge(self, other: Self) -> None:
        """Take in what another one has taken in."""
        self._first, self._last = min(self._first, other._first), max(self._last, other._last)

    def compute(self) -> tuple[float, ...]:
        """Seconds."""
        return (self._last - self._first if self._last >= self._first else 0.0,)


@register
class RmsError(RootMeanSquare):
    """Root mean square of e = x - x_d, m, m, rad."""

    name, place = "rms_error", 10
    columns = (
        Column("rms-x", "RMS error x", "RMS x", "mm", 1e3, listed=True, part="x"),
        Column("rms-y", "RMS error y", "RMS y", "mm", 1e3, listed=True, part="y"),
        Column("rms-theta", "RMS error θ", "RMS θ", "mrad", 1e3, part="theta"),
    )

    def signal(self, samples: "Samples") -> np.ndarray:
        """e, (N, 3)."""
        return samples.tracking_error


@register
class RmsInternalForce(RootMeanSquare):
    """Root mean square of the (x, y) part of the left arm's internal force, N."""

    name, place = "rms_internal_force", 60
    columns = (Column("force", "RMS internal force", "RMS force", "N", listed=True),)

    def signal(self, samples: "Samples") -> np.ndarray:
        """The size of the force, (N, 1)."""
        return np.hypot(samples.internal_force[:, 0, 0], samples.internal_force[:, 0, 1])[:, None]


@register
class RmsInternalMoment(RootMeanSquare):
    """Root mean square of its moment, N·m."""

    name, place = "rms_internal_moment", 61
    columns = (Column("moment", "RMS internal moment", "RMS moment", "N·m"),)

    def signal(self, samples: "Samples") -> np.ndarray:
        """The moment, (N, 1)."""
        return samples.internal_force[:, 0, 2:]


@register
class PeakError(Peak):
    """Largest |e|, m, m, rad."""

    name, place = "peak_error", 20
    columns = (
        Column("peak-x", "Peak error x", "peak x", "mm", 1e3, part="x"),
        Column("peak-y", "Peak error y", "peak y", "mm", 1e3, part="y"),
        Column("peak-theta", "Peak error θ", "peak θ", "mrad", 1e3, part="theta"),
    )

    def signal(self, samples: "Samples") -> np.ndarray:
        """e, (N, 3)."""
        return samples.tracking_error


@register
class PeakVibration(Peak):
    """Largest magnitude of the mid-span deflection less its quasi-static part, m."""

    name, place = "peak_vibration", 30
    columns = (Column("vibration", "Peak vibration", "vibration", "mm", 1e3, listed=True),)

    def signal(self, samples: "Samples") -> np.ndarray:
        """The vibration, (N, 1)."""
        return samples.vibration[:, None]


@register
class PeakAxialLoad(Peak):
    """Largest compression of the beam beside its buckling load, %."""

    name, place = "peak_axial_load", 47
    columns = (Column("axial", "Peak compression of P_cr", "compression", "%", scale=100.0),)

    def signal(self, samples: "Samples") -> np.ndarray:
        """The share of an instant, (N, 1)."""
        return np.asarray(samples.axial_load_share)[:, None]


@register
class PeakTorque(Peak):
    """Largest magnitude of any joint's torque, N·m."""

    name, place = "peak_torque", 50
    columns = (Column("torque", "Peak joint torque", "torque", "N·m", listed=True),)

    def signal(self, samples: "Samples") -> np.ndarray:
        """The largest torque of an instant, (N, 1)."""
        return np.max(np.abs(samples.joint_torque), axis=(1, 2))[:, None]
