"""A sequence of poses, with a rest at each and limited velocity, acceleration and jerk."""

import math
from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from flexlab.compiled import pluggable
from flexlab.control.path import Path, Trajectory, at_nearest_turn
from flexlab.control.paths.table import row_before
from flexlab.control.phase import three
from flexlab.quantities import Number, OneOrThree, Triple, quantity

MOST_POINTS = 200
MILLI = 1e-3


class Waypoints(Trajectory):
    """From pose to pose on straight lines, each as fast as the limits allow, with a rest of `pause` s at each; the last is held.

    A pose equal to the one before it is skipped, with its pause. Between two poses jerk is piecewise constant: up to seven
    phases (Biagiotti and Melchiorri, Trajectory Planning for Automatic Machines and Robots, 2008, section 3.4).
    """

    kind: Literal["waypoints"] = "waypoints"
    points: Annotated[tuple[Triple, ...], Field(min_length=1, max_length=MOST_POINTS)] = quantity(
        ((0.0, 0.65, 0.0), (0.1, 0.8, 0.2), (-0.1, 0.8, -0.2), (0.0, 0.65, 0.0)), "Poses", unit="m, m, rad", low=-100,
        high=100,
    )  # fmt: skip
    velocity_limit: OneOrThree = quantity(
        1.0, "Velocity limit", "v_max", "m/s, m/s, rad/s", low=1e-3, high=100, slider=(0.1, 3)
    )
    acceleration_limit: OneOrThree = quantity(
        5.0, "Acceleration limit", "a_max", "m/s², m/s², rad/s²", low=1e-3, high=1e4, slider=(0.5, 20)
    )
    jerk_limit: OneOrThree = quantity(
        100.0, "Jerk limit", "j_max", "m/s³, m/s³, rad/s³", low=1e-3, high=1e7, slider=(10, 10000), logarithmic=True
    )
    pause: Number = quantity(0.2, "Pause in each", "T_p", "s", low=0, high=100, slider=(0, 2))
    start: Number = quantity(0.0, "Begins at", "t_0", "s", low=0, high=1e6)

    def phases(self) -> np.ndarray:
        """Rows of `phases` of this path."""
        limits = tuple(three(limit) for limit in (self.velocity_limit, self.acceleration_limit, self.jerk_limit))
        return phases(self.points, limits, self.pause)

    @property
    def span(self) -> float:
        """When the last pose is reached, s."""
        return self.start + float(self.phases()[-1, 0])

    @property
    def end(self) -> float:
        """When it ends, s."""
        return self.span

    @property
    def discontinuities(self) -> tuple[float, ...]:
        """Instants at which a phase of constant jerk begins, s."""
        return tuple((self.start + self.phases()[:, 0]).tolist())

    @property
    def window(self) -> tuple[float, float]:
        """Its beginning and end, s."""
        return self.start, self.span if self.span > self.start else self.start + 1.0

    @property
    def slowest_period(self) -> float:
        """Its duration, s."""
        return self.window[1] - self.window[0]

    @property
    def middle(self) -> tuple[float, ...]:
        """The centre of the box around the poses."""
        return tuple(0.5 * (min(axis) + max(axis)) for axis in zip(*self.points, strict=True))

    @property
    def reach(self) -> tuple[float, ...]:
        """Half the size of the box around the poses."""
        return tuple(0.5 * (max(axis) - min(axis)) for axis in zip(*self.points, strict=True))

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """Largest |ẍ_d|; it is reached where a phase ends."""
        return tuple(np.abs(self.phases()[:, 7:10]).max(axis=0).tolist())

    def keeping(self, changed: Trajectory, changes: Mapping[str, Any], time: float) -> Trajectory:
        """With other poses or limits it starts again from the first pose now."""
        if not isinstance(changed, Waypoints) or "start" in changes or not set(changes) & CHANGE_THE_WAY:
            return changed
        return changed.model_copy(update={"start": round(time / MILLI) * MILLI})

    def taken_up(self, old: Trajectory, given: Collection[str], time: float) -> Trajectory:
        """It begins now; default poses are moved to the old path's middle."""
        usual: dict[str, Any] = {"start": round(time / MILLI) * MILLI}
        if "points" not in given:
            moved = np.array(self.points) + np.subtract(at_nearest_turn(old.middle, old, time), self.middle)
            usual["points"] = tuple(map(tuple, moved.tolist()))
        return self.model_copy(update={name: value for name, value in usual.items() if name not in given})


CHANGE_THE_WAY = {"points", "velocity_limit", "acceleration_limit", "jerk_limit", "pause"}


@lru_cache(maxsize=32)
def phases(points: tuple[Triple, ...], limits: tuple[Triple, ...], pause: float) -> np.ndarray:
    """Phases of constant jerk, rows (time it begins, s; pose, rate, acceleration, jerk), (phases, 13); the last is rest.

    limits: velocity, acceleration and jerk of x, y, θ.
    """
    rows, begin = [], 0.0
    for here, there in zip(points[:-1], points[1:], strict=True):
        if here == there:
            continue
        leg = _leg(here, there, limits)
        leg[:, 0] += begin
        begin = float(leg[-1, 0]) + pause
        rows.append(leg)
    if not rows:
        rows = [np.array([[0.0, *points[-1], *[0.0] * 9]])]
    found = np.concatenate(rows)
    found.flags.writeable = False
    return found


def _leg(here: Triple, there: Triple, limits: tuple[Triple, ...]) -> np.ndarray:
    """As `phases`, for one straight line from rest to rest, along which the share goes from 0 to 1 within all limits."""
    way = np.subtract(there, here)
    allowed = [float(np.min(np.array(limit)[way != 0] / np.abs(way[way != 0]))) for limit in limits]
    rising, steady, cruise = _durations(*allowed)
    jerks = allowed[2] * np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])
    spans = np.array([rising, steady, rising, cruise, rising, steady, rising])
    lasting = spans > 0
    spans, jerks = spans[lasting], jerks[lasting]
    rows, state = np.zeros((len(spans) + 1, 13)), (0.0, 0.0, 0.0)
    rows[:, 0] = np.cumsum([0.0, *spans])
    for row, t, j in zip(rows, spans.tolist(), jerks.tolist(), strict=False):
        p, v, a = state
        row[1:] = np.concatenate([here + p * way, v * way, a * way, j * way])
        state = p + t * (v + t * (a / 2 + t * j / 6)), v + t * (a + t * j / 2), a + t * j
    rows[-1, 1:] = (*there, *[0.0] * 9)
    return rows[np.append(np.diff(rows[:, 0]) > 0, True)]


def _durations(velocity: float, acceleration: float, jerk: float) -> tuple[float, float, float]:
    """Times of the fastest motion of length 1 from rest to rest, s: up to the largest acceleration, at it, and at full speed."""
    rising = acceleration / jerk
    if velocity >= acceleration * rising:
        steady = velocity / acceleration - rising
    else:
        rising, steady = math.sqrt(velocity / jerk), 0.0
    cruise = 1 / velocity - (2 * rising + steady)
    if cruise >= 0:
        return rising, steady, cruise
    # The speed is not reached: a (T_j + T_a)(2 T_j + T_a) = 1, or 2 j T_j³ = 1 where the acceleration is not, either.
    rising = acceleration / jerk
    steady = (math.sqrt(rising * rising + 4 / acceleration) - 3 * rising) / 2
    return (rising, steady, 0.0) if steady >= 0 else (_cube_root(0.5 / jerk), 0.0, 0.0)


def _cube_root(value: float) -> float:
    """Cube root of a positive number, by Newton's method from a power of two above it."""
    root = math.ldexp(1.0, -(-math.frexp(value)[1] // 3))
    while (lower := root - (root - value / (root * root)) / 3) < root:
        root = lower
    return root


@pluggable
def waypoints(path, rows, t, desired):
    """The phase's cubic."""
    k = row_before(rows, t - path.start)
    dt = max(t - path.start - rows[k, 0], 0.0)
    for a in range(3):
        p, v, g, jerk = rows[k, 1 + a], rows[k, 4 + a], rows[k, 7 + a], rows[k, 10 + a]
        desired[0, a] = p + dt * (v + dt * (g / 2 + dt * jerk / 6))
        desired[1, a] = v + dt * (g + dt * jerk / 2)
        desired[2, a] = g + dt * jerk


PATH = Path(Waypoints, waypoints, rows=Waypoints.phases, place=60)
