"""A straight line from one pose to another, shared by paths from rest to rest."""

from collections.abc import Collection
from typing import Any

from flexlab.compiled import inlined
from flexlab.control.motion import poses
from flexlab.control.path import Trajectory, at_nearest_turn, build_motion
from flexlab.quantities import Number, Triple, quantity

POSE_UNIT = "m, m, rad"
MILLI = 1e-3


class StraightLine(Trajectory):
    """From one pose to another in `duration` s, beginning at `start` s; the first is held before, the second afterwards."""

    # Python has no attribute "from", but it is the right name in a scenario.
    __annotations__["from"] = Triple
    locals()["from"] = quantity((0.0, 0.65, 0.0), "From (x, y, θ)", "x_0", POSE_UNIT, low=-100, high=100)
    to: Triple = quantity((0.0, 0.85, 0.0), "To (x, y, θ)", "x_1", POSE_UNIT, low=-100, high=100, slider=(-1, 1.5))
    start: Number = quantity(0.0, "Begins at", "t_0", "s", low=0, high=1e6)
    duration: Number = quantity(0.5, "Duration", "T_m", "s", low=0.01, high=1e3, slider=(0.1, 3))

    @property
    def span(self) -> float:
        """When it ends, s."""
        return self.start + self.duration

    @property
    def end(self) -> float:
        """When it ends, s."""
        return self.span

    @property
    def window(self) -> tuple[float, float]:
        """Its beginning and end, s."""
        return self.start, self.span

    @property
    def slowest_period(self) -> float:
        """Its duration, s."""
        return self.duration

    @property
    def middle(self) -> tuple[float, ...]:
        """The pose half way."""
        return tuple(0.5 * (a + b) for a, b in self._ends())

    @property
    def reach(self) -> tuple[float, ...]:
        """Half the distance."""
        return tuple(0.5 * abs(b - a) for a, b in self._ends())

    def _ends(self) -> list[tuple[float, float]]:
        return list(zip(getattr(self, "from"), self.to, strict=True))

    def peak(self, factor: float) -> tuple[float, ...]:
        """factor · way / duration², (3,)."""
        return tuple(factor * abs(b - a) / (self.duration * self.duration) for a, b in self._ends())

    def taken_up(self, old: Trajectory, given: Collection[str], time: float) -> Trajectory:
        """It begins now, from the present target to where the old path would be a quarter of its period later."""
        motion, begin = build_motion(old), round(time / MILLI) * MILLI
        here, there = poses(motion, [time, time + 0.25 * old.slowest_period])[:, 0].tolist()
        usual: dict[str, Any] = {"from": tuple(here), "to": at_nearest_turn(there, old, time), "start": begin}
        return self.model_copy(update={name: value for name, value in usual.items() if name not in given})


@inlined
def share_of_time(path, t):
    """τ = (t - start) / duration within 0 and 1."""
    return min(max((t - path.start) / path.duration, 0.0), 1.0)


@inlined
def along_line(path, share, rate, curvature, desired):
    """x_d, ẋ_d, ẍ_d (3, 3) at a share of the way whose derivatives with respect to τ are `rate` and `curvature`."""
    for a in range(3):
        begin, way = path["from"][a], path.to[a] - path["from"][a]
        desired[0, a] = begin + way * share
        desired[1, a] = way * rate / path.duration
        desired[2, a] = way * curvature / (path.duration * path.duration)
