"""How far the payload is from its path on average."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.metrics.metric import Column, RootMeanSquare, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


@register
class RmsError(RootMeanSquare):
    """Root mean square of e = x - x_d, m, m, rad."""

    name, place = "rms_error", 10
    columns = (
        Column("rms-x", "RMS error x", "RMS x", "mm", 1e3, listed=True),
        Column("rms-y", "RMS error y", "RMS y", "mm", 1e3, listed=True),
        Column("rms-theta", "RMS error θ", "RMS θ", "mrad", 1e3),
    )

    def signal(self, samples: "Samples") -> np.ndarray:
        """e, (N, 3)."""
        return samples.tracking_error
