"""The fastest way from rest to rest with a limited acceleration: constant acceleration, then the same braking."""

from typing import Literal

from flexlab.compiled import pluggable
from flexlab.control.path import Path
from flexlab.control.straight_line import StraightLine, along_line, share_of_time


class BangBang(StraightLine):
    """x_d = from + (to - from) 2τ² up to τ = ½, then to - (to - from) 2(1 - τ)²; τ = (t - start) / duration.

    The acceleration 4 (to - from) / duration² jumps at the start, in the middle and at the end, and every jump rings the beam.
    """

    kind: Literal["bang-bang"] = "bang-bang"

    @property
    def jumps(self) -> bool:
        """True: the acceleration always jumps."""
        return True

    @property
    def discontinuities(self) -> tuple[float, ...]:
        """Instants at which it starts, turns to braking and stops, s."""
        return self.start, self.start + 0.5 * self.duration, self.span

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """4 way / duration²."""
        return self.peak(4.0)


@pluggable
def bang_bang(path, rows, t, desired):
    """Two parabolas; no acceleration outside the motion, and at its first instant the one that follows."""
    u = share_of_time(path, t)
    if t < path.start or u >= 1.0:
        along_line(path, u, 0.0, 0.0, desired)
    elif u < 0.5:
        along_line(path, 2 * u * u, 4 * u, 4.0, desired)
    else:
        along_line(path, 1 - 2 * (1 - u) * (1 - u), 4 * (1 - u), -4.0, desired)


PATH = Path(BangBang, bang_bang, place=30)
