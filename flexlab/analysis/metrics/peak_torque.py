"""What the motors must be able to give."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.metrics.metric import Column, Peak, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


@register
class PeakTorque(Peak):
    """Largest magnitude of any joint's torque, N·m."""

    name, place = "peak_torque", 50
    columns = (Column("torque", "Peak joint torque", "torque", "N·m", listed=True),)

    def signal(self, samples: "Samples") -> np.ndarray:
        """The largest torque of an instant, (N, 1)."""
        return np.max(np.abs(samples.joint_torque), axis=(1, 2))[:, None]
