"""Largest magnitudes: tracking error, vibration, compression, joint torque."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.metrics.metric import Column, Peak, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


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
