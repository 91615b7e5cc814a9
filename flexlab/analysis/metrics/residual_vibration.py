"""The residual vibration of the beam after a motion has stopped."""

from typing import TYPE_CHECKING

import numpy as np

from flexlab.analysis.metrics.metric import Column, Metric, outlasting, register
from flexlab.analysis.metrics.run_metrics import ROUNDING

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples

LATER = 0.2
"""Time after the stop from which the second number counts, s, as if the next move waited that long."""
STOPPED = 0.01
"""Time for which the target must stand still at the end of the samples, s, so that a turning point is not a stop."""


@register
class ResidualVibration(Metric):
    """Largest |vibration| after the last instant at which the desired pose moved, and from `LATER` s after it on, m.

    NaN if the target never moved or has not stopped, or if the vibration is not recorded, which is the mid-span deflection less
    its quasi-static part.
    """

    name, place = "residual_vibration", 35
    columns = (
        Column("residual", "Residual vibration after the stop", "residual", "mm", 1e3, part="stop"),
        Column(
            "residual-later",
            f"Residual vibration {LATER:g} s after the stop",
            f"residual {LATER:g} s",
            "mm",
            1e3,
            part="later",
        ),
    )

    # A sample that is followed by a louder one can never be the loudest after the stop, so few have to be kept.
    # The target stands still from the sample after its last motion on: one still sample alone is not a stop.

    def __init__(self) -> None:
        self._last, self._pose = -np.inf, np.full(3, np.nan)
        self._moved = self._stands = -np.inf
        self._time = np.empty(0)
        self._size = np.empty(0)

    def update(self, samples: "Samples") -> None:
        """Take in the next piece of a run."""
        time, pose = samples.time, np.array(samples.desired_pose[-1])
        moving = np.flatnonzero(np.any(samples.desired_pose != pose, axis=1))
        if len(moving):
            # A measurement has no target: NaN never equals itself, so that it seems to move up to the last sample.
            stands = min(moving[-1] + 1, len(time) - 1)
            self._moved, self._stands = float(time[moving[-1]]), float(time[stands])
        elif not np.array_equal(self._pose, pose):  # The target has moved since the piece before, if there was one.
            self._moved, self._stands = self._last, float(time[0])
        self._last, self._pose = float(time[-1]), pose
        size = np.nan_to_num(np.abs(samples.vibration), nan=np.inf)  # NaN, not recorded, may have been any size.
        time, size = np.concatenate([self._time, time]), np.concatenate([self._size, size])
        after = time > self._moved
        self._time, self._size = outlasting(time[after], size[after])

    @property
    def stop(self) -> float:
        """Last instant at which the target moved, s; NaN if it never moved or has not stopped."""
        stopped = np.isfinite(self._moved) and self._last - self._stands >= STOPPED - ROUNDING
        return self._moved if stopped else np.nan

    def compute(self) -> tuple[float, ...]:
        """Largest |vibration| after the stop and later, m."""
        return self._after(self.stop), self._after(self.stop + LATER)

    def _after(self, time: float) -> float:
        largest = float(np.max(self._size[self._time > time], initial=0.0)) if self._last > time else np.nan
        return largest if largest < np.inf else np.nan
