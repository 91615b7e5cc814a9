"""From rest to rest along a straight line, as smoothly as a quintic can."""

from typing import Literal

import numpy as np

from flexlab.compiled import pluggable
from flexlab.control.path import Path
from flexlab.control.straight_line import StraightLine, along_line, share_of_time


class RestToRest(StraightLine):
    """x_d = from + (to - from)(10τ³ - 15τ⁴ + 6τ⁵), τ = (t - start) / duration.

    Velocity and acceleration are zero at both ends.
    """

    kind: Literal["rest-to-rest"] = "rest-to-rest"

    @property
    def discontinuities(self) -> tuple[float, ...]:
        """Both ends, where the jerk jumps, s."""
        return self.window

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """10/√3 way / duration², at τ = ½ ± √3/6."""
        return self.peak(10 / np.sqrt(3))


@pluggable
def rest_to_rest(path, rows, t, desired):
    """The quintic and its derivatives."""
    u = share_of_time(path, t)
    w = 1 - u
    along_line(path, u * u * u * (10 - 15 * u + 6 * u * u), 30 * u * u * w * w, 60 * u * w * (w - u), desired)


PATH = Path(RestToRest, rest_to_rest, place=20)
