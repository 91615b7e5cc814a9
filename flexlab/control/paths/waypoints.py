"""Through poses one after another, at rest in each, with limited velocity, acceleration and jerk."""

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from ruckig import InputParameter, Result, Ruckig, RuckigError
from ruckig import Trajectory as Profiles

from flexlab.compiled import pluggable
from flexlab.control.path import Path, Trajectory
from flexlab.control.phase import three
from flexlab.control.row_search import row_before
from flexlab.quantities import Number, OneOrThree, Triple, quantity

MOST_POINTS = 200
MILLI = 1e-3


class Waypoints(Trajectory):
    """From pose to pose on straight lines, each as fast as the limits allow, `pause` s in each; the last one is held.

    Between two poses jerk is piecewise constant (the library ruckig: Berscheid & Kröger, RSS 2021).
    """

    kind: Literal["waypoints"] = "waypoints"
    points: Annotated[tuple[Triple, ...], Field(min_length=1, max_length=MOST_POINTS)] = quantity(
        ((0.0, 0.65, 0.0), (0.1, 0.8, 0.2), (-0.1, 0.8, -0.2), (0.0, 0.65, 0.0)),
        title="Poses",
        unit="m, m, rad",
        low=-20,
        high=20,
    )
    velocity_limit: OneOrThree = quantity(
        1.0, title="Velocity limit", symbol="v_max", unit="m/s, m/s, rad/s", low=1e-3, high=100, slider=(0.1, 3)
    )
    acceleration_limit: OneOrThree = quantity(
        5.0, title="Acceleration limit", symbol="a_max", unit="m/s², m/s², rad/s²", low=1e-3, high=1e4, slider=(0.5, 20)
    )
    jerk_limit: OneOrThree = quantity(
        100.0,
        title="Jerk limit",
        symbol="j_max",
        unit="m/s³, m/s³, rad/s³",
        low=1e-3,
        high=1e7,
        slider=(10, 10000),
        logarithmic=True,
    )
    pause: Number = quantity(0.2, title="Pause in each", symbol="T_p", unit="s", low=0, high=100, slider=(0, 2))
    start: Number = quantity(0.0, title="Begins at", symbol="t_0", unit="s", low=0, high=1e6)

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
        """s."""
        return self.span

    @property
    def kinks(self) -> tuple[float, ...]:
        """Where a phase of constant jerk begins."""
        return tuple((self.start + self.phases()[:, 0]).tolist())

    @property
    def window(self) -> tuple[float, float]:
        """s."""
        return self.start, self.span if self.span > self.start else self.start + 1.0

    @property
    def slowest_period(self) -> float:
        """s."""
        return self.window[1] - self.window[0]

    @property
    def middle(self) -> tuple[float, ...]:
        """The middle of the poses' box."""
        return tuple(0.5 * (min(axis) + max(axis)) for axis in zip(*self.points, strict=True))

    @property
    def reach(self) -> tuple[float, ...]:
        """Half the poses' box."""
        return tuple(0.5 * (max(axis) - min(axis)) for axis in zip(*self.points, strict=True))

    @property
    def peak_acceleration(self) -> tuple[float, ...]:
        """Largest |ẍ_d|; it is reached where a phase ends."""
        return tuple(np.abs(self.phases()[:, 7:10]).max(axis=0).tolist())

    def keeping(self, changed: Trajectory, changes: Mapping[str, Any], time: float) -> Trajectory:
        """Other poses or limits: from the first pose again, from now on."""
        if not isinstance(changed, Waypoints) or "start" in changes or not set(changes) & CHANGE_THE_WAY:
            return changed
        return changed.model_copy(update={"start": round(time / MILLI) * MILLI})

    def taken_up(self, old: Trajectory, given: Collection[str], time: float) -> Trajectory:
        """From now on; poses that nobody gave lie about the old path's middle."""
        usual: dict[str, Any] = {"start": round(time / MILLI) * MILLI}
        if "points" not in given:
            moved = np.array(self.points) + np.subtract(old.middle, self.middle)
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
    """As `phases`, of one straight way from rest to rest: the share of the way moves from 0 to 1 within all limits."""
    way = np.subtract(there, here)
    allowed = [float(np.min(np.array(limit)[way != 0] / np.abs(way[way != 0]))) for limit in limits]
    try:
        found, unit = _profile(*allowed), 1.0
    except RuckigError:
        # Of very large limits ruckig loses the digits, but not with a unit of time, s, in which the jerk is 1.
        unit = allowed[2] ** (-1 / 3)
        found = _profile(allowed[0] * unit, allowed[1] * unit**2, 1.0)
    last = len(found.t)
    rows = np.zeros((last + 1, 13))
    rows[:, 0] = np.cumsum([0.0, *found.t]) * unit
    rows[:, 1:4] = here + np.outer(found.p, way)
    for order, values in enumerate((found.v, found.a, [*found.j, 0.0]), 1):
        rows[:, 1 + 3 * order : 4 + 3 * order] = np.outer(values, way) / unit**order
    rows[last, 1:] = (*there, *[0.0] * 9)
    return rows[np.append(np.diff(rows[:, 0]) > 0, True)]


def _profile(velocity: float, acceleration: float, jerk: float) -> Any:
    """ruckig's phases of the share from 0 to 1 within these limits. Raises `RuckigError`."""
    wanted = InputParameter(1)
    wanted.target_position = [1.0]
    wanted.max_velocity, wanted.max_acceleration, wanted.max_jerk = [velocity], [acceleration], [jerk]
    profiles = Profiles(1)
    if Ruckig(1).calculate(wanted, profiles) not in (Result.Working, Result.Finished):
        raise RuckigError(f"no way within {velocity}, {acceleration}, {jerk}")
    return profiles.profiles[0][0]


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
