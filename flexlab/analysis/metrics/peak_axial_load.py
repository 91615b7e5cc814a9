"""How near the beam comes to buckling."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.metrics.metric import Column, Peak, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


@register
class PeakAxialLoad(Peak):
    """Largest compression of the beam beside its buckling load, %."""

    name, place = "peak_axial_load", 47
    columns = (Column("axial", "Peak compression of P_cr", "compression", "%", scale=100.0),)

    def signal(self, samples: "Samples") -> np.ndarray:
        """The share of an instant, (N, 1)."""
        return np.asarray(samples.axial_load_share)[:, None]
