"""Motions between waypoints: limits, durations of their legs, pauses."""

from collections.abc import Callable, Iterator

import numpy as np

from flexlab.analysis.validation.check import Check, Runs, below, close, subject
from flexlab.analysis.validation.paths import BEGIN, motion_of, poses

LEGS: dict[str, tuple[float, float, float, Callable[[float, float, float, float], float]]] = {
    "its largest speed and acceleration": (0.4, 3.0, 40.0, lambda way, v, a, j: way / v + v / a + a / j),
    "its largest speed alone": (0.1, 3.0, 40.0, lambda way, v, a, j: way / v + 2 * np.sqrt(v / j)),
    "its largest acceleration alone": (
        4.0,
        3.0,
        40.0,
        lambda way, v, a, j: a / j + np.sqrt((a / j) ** 2 + 4 * way / a),
    ),
    "neither": (4.0, 30.0, 40.0, lambda way, v, a, j: 4 * np.cbrt(way / (2 * j))),
}
"""What a leg reaches → limits of speed, acceleration and jerk, and its shortest duration, s, from its length and these limits.

Biagiotti, Melchiorri: Trajectory Planning for Automatic Machines and Robots (2008), 3.4.
"""
WAY = 0.3
"""Length of such a leg, m."""
LIMITS = {"velocity_limit": (0.5, 0.2, 1.0), "acceleration_limit": (4.0, 6.0, 2.0), "jerk_limit": (80.0, 500.0, 90.0)}
"""Limits of x, y and θ."""
TURNED, PAUSE = 0.4, 0.15
"""Angle by which a leg turns, rad, and rest after each but the last, s."""


@subject("Waypoints", 7)
def waypoints(_: Runs) -> Iterator[Check]:
    """Poses and limits of a motion between waypoints, its legs, its pauses."""
    yield from _within_limits()
    yield from _legs()
    yield _stops()


def _within_limits() -> Iterator[Check]:
    path, motion = motion_of("waypoints", velocity_limit=0.4, acceleration_limit=3.0, jerk_limit=40.0)
    t = np.arange(0.0, float(path.end), 1e-3)
    found = poses(motion, t)
    passed = max(np.linalg.norm(found[:, 0] - np.array(point), axis=1).min() for point in path.points)
    yield below("waypoints: passes every pose: farthest away, m, rad", 1e-9, passed)
    for words, values, limit, unit in (
        ("velocity", found[:, 1], 0.4, "m/s, rad/s"),
        ("acceleration", found[:, 2], 3.0, "m/s², rad/s²"),
        ("jerk", np.diff(found[:, 2], axis=0) / 1e-3, 40.0, "m/s³, rad/s³"),
    ):
        yield close(f"waypoints: largest {words} is its limit", limit, np.abs(values).max(), unit, relative=1e-6)


def _legs() -> Iterator[Check]:
    for words, (*limits, duration) in LEGS.items():
        along = dict(zip(("velocity_limit", "acceleration_limit", "jerk_limit"), limits, strict=True))
        path, motion = motion_of("waypoints", points=((0.0, 0.75, 0.0), (WAY, 0.75, 0.0)), start=BEGIN, **along)
        shortest = duration(WAY, *limits)
        yield close(
            f"waypoints: duration of a leg that reaches {words}", shortest, float(path.end) - BEGIN, "s", relative=1e-12
        )
        last = poses(motion, [float(path.end) - 1e-9])[0, 0, 0]
        yield close("and its end, a nanosecond before", WAY, last, "m", absolute=1e-12)


def _stops() -> Check:
    """Legs in x, θ and y, then one in x and a little in y, with rests between: each axis has its own limits."""
    far, up = 0.75 + WAY, 0.75 + 1.2 * WAY
    corners = (
        (0.0, 0.75, 0.0),
        (WAY, 0.75, 0.0),
        (WAY, 0.75, TURNED),
        (WAY, 0.75, TURNED),
        (WAY, far, TURNED),
        (0.0, up, TURNED),
    )
    path, _ = motion_of("waypoints", points=corners, pause=PAUSE, **LIMITS)
    longest = LEGS["its largest speed and acceleration"][3], LEGS["its largest acceleration alone"][3]
    each = [[*limit, way] for *limit, way in zip(*LIMITS.values(), (WAY, WAY, TURNED), strict=True)]
    in_x, *others = (longest[axis == 2](way, v, a, j) for axis, (v, a, j, way) in enumerate(each))
    statement = "waypoints: legs in x, y, θ, x and y with pauses between: time that they take"
    return close(statement, 2 * in_x + sum(others) + 3 * PAUSE, float(path.end), "s", relative=1e-12)
