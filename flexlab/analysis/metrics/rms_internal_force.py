"""How hard the arms press against each other through the beam."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.metrics.metric import Column, RootMeanSquare, register

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples


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
