"""How far the payload is from its path at worst."""

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
        Column("peak-x", "Peak error x", "peak x", "mm", 1e3),
        Column("peak-y", "Peak error y", "peak y", "mm", 1e3),
        Column("peak-theta", "Peak error θ", "peak θ", "mrad", 1e3),
    )

    def signal(self, samples: "Samples") -> np.ndarray:
        """e, (N, 3)."""
        return samples.tracking_error
