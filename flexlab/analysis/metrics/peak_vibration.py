"""How much the beam rings."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.metrics.metric import Column, Peak, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


@register
class PeakVibration(Peak):
    """Largest magnitude of the mid-span deflection less its quasi-static part, m."""

    name, place = "peak_vibration", 30
    columns = (Column("vibration", "Peak vibration", "vibration", "mm", 1e3, listed=True),)

    def signal(self, samples: "Samples") -> np.ndarray:
        """The vibration, (N, 1)."""
        return samples.vibration[:, None]
