"""The desired motion as kernels take it: a path, and what every path may have besides.

At time t ≥ 0 the target is Σ A_j x(t - t_j) + d(t): x the path, entered at growing speed over `ramp` s (`path_time`), A_j and
t_j the impulses of an input shaper (`control.shapers`), d what a live change left over (`transition`). Before t = 0 every
path stands at x(0), periodic ones too: an impulse's copy begins when its time has come.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlab.compiled import call_kernel, compiled, inlined

NO_ROWS = np.zeros((0, 1))
"""Of paths whose numbers are few."""
NO_SHAPER = np.zeros((0, 2))
NO_TRANSITION = np.zeros(11)
NO_KINKS = np.zeros(0)
INSIDE = 1e-14
"""s, per second since t = 0. A step that ends at a jump of the acceleration knows nothing yet of what comes after, one that
begins there nothing any more of what was before: else both are of first order. Ten times what instants are rounded by."""


class DesiredMotion(NamedTuple):
    """A path as kernels take it."""

    kernel: int
    """Address of the path's kernel."""
    numbers: np.ndarray
    """The path's record, flat."""
    rows: np.ndarray
    """The path's table, (rows, columns); no rows of most."""
    plain: bool = True
    """Whether the path is all there is: no ramp, shaper or transition."""
    ramp: float = 0.0
    """Time over which the path is entered, s."""
    impulses: np.ndarray = NO_SHAPER
    """A_j and t_j, s, of the shaper, (impulses, 2); none: unshaped."""
    transition: np.ndarray = NO_TRANSITION
    """Instant and duration, s, then the pose, rate and acceleration that are left over at that instant, (11,)."""
    bending: float = 0.0
    """Share of the quasi-static bending's force that is fed forward, 1 (`control.load_sharing`)."""
    inside: float = 0.0
    """How far inside a step its first and last stage look at a path whose acceleration jumps, s: see `INSIDE`; 0 of others."""
    kinks: np.ndarray = NO_KINKS
    """Instants at which velocity, acceleration or jerk jump, s, in order: there a step has to end (`sim.kinks`)."""


@inlined
def path_time(t, ramp):
    """Time along the path at time t, s, its rate and its rate's rate, 1/s.

    The rate grows from 0 to 1 over `ramp` as 10τ³ - 15τ⁴ + 6τ⁵: the path's shape stays, half of `ramp` is lost. 0 before t = 0.
    """
    if t < 0:
        return 0.0, 0.0, 0.0
    if t >= ramp:
        return t - 0.5 * ramp, 1.0, 0.0
    u = t / ramp
    cube = u * u * u
    return (
        ramp * cube * u * (2.5 - 3 * u + u * u),
        cube * (10 - 15 * u + 6 * u * u),
        30 * u * u * (1 - u) * (1 - u) / ramp,
    )


def time_of(along: float, ramp: float) -> float:
    """The time at which a path entered over `ramp` is `along` s along itself: the inverse of `path_time`, s."""
    if along >= 0.5 * ramp:
        return along + 0.5 * ramp
    low, high = 0.0, ramp
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if path_time(middle, ramp)[0] < along else (low, middle)
    return high


@inlined
def _entered(path, t, desired):
    """The path itself at time t, entered over its ramp."""
    along, rate, growth = path_time(t, path.ramp)
    call_kernel(path.kernel, path.numbers, (path.rows, along, desired))
    for a in range(3):
        desired[2, a] = desired[2, a] * rate * rate + desired[1, a] * growth
        desired[1, a] *= rate


@inlined
def _add_transition(transition, t, desired):
    """Add what a live change left over: a quintic that takes pose, rate and acceleration to zero."""
    begin, duration = transition[0], transition[1]
    if not begin <= t < begin + duration:
        return
    u, T = (t - begin) / duration, duration
    w = 1 - u
    # Three quintics with one, and then no, initial value, slope or curvature; all of them end at zero in all three.
    h, dh, ddh = w * w * w * (1 + 3 * u + 6 * u * u), -30 * u * u * w * w, -60 * u * w * (1 - 2 * u)
    k, dk, ddk = u * w * w * w * (1 + 3 * u), w * w * (1 - 3 * u) * (1 + 5 * u), -12 * u * w * (3 - 5 * u)
    c, dc, ddc = 0.5 * u * u * w * w * w, 0.5 * u * w * w * (2 - 5 * u), w * (1 - 8 * u + 10 * u * u)
    for a in range(3):
        x, v, g = transition[2 + a], T * transition[5 + a], T * T * transition[8 + a]
        desired[0, a] += x * h + v * k + g * c
        desired[1, a] += (x * dh + v * dk + g * dc) / T
        desired[2, a] += (x * ddh + v * ddk + g * ddc) / (T * T)


@compiled
def altered_motion(path, t, desired):
    """Fill x_d, ẋ_d, ẍ_d (3, 3) of a path with ramp, shaper or transition at time t, s."""
    if len(path.impulses) == 0:
        _entered(path, t, desired)
    else:
        p0 = p1 = p2 = v0 = v1 = v2 = a0 = a1 = a2 = 0.0
        for j in range(len(path.impulses)):
            A = path.impulses[j, 0]
            _entered(path, t - path.impulses[j, 1], desired)
            p0, p1, p2 = p0 + A * desired[0, 0], p1 + A * desired[0, 1], p2 + A * desired[0, 2]
            v0, v1, v2 = v0 + A * desired[1, 0], v1 + A * desired[1, 1], v2 + A * desired[1, 2]
            a0, a1, a2 = a0 + A * desired[2, 0], a1 + A * desired[2, 1], a2 + A * desired[2, 2]
        desired[0, 0], desired[0, 1], desired[0, 2] = p0, p1, p2
        desired[1, 0], desired[1, 1], desired[1, 2] = v0, v1, v2
        desired[2, 0], desired[2, 1], desired[2, 2] = a0, a1, a2
    _add_transition(path.transition, t, desired)


@inlined
def desired_motion(path, t, desired):
    """Fill x_d, ẋ_d, ẍ_d (3, 3) at time t ≥ 0, s."""
    if path.plain:
        call_kernel(path.kernel, path.numbers, (path.rows, t, desired))
    else:
        altered_motion(path, t, desired)


@compiled
def desired_motions(path, times, desired):
    """Fill x_d, ẋ_d, ẍ_d (N, 3, 3) at times (N,), s."""
    for k in range(len(times)):
        desired_motion(path, times[k], desired[k])


def poses(path: DesiredMotion, times: ArrayLike) -> np.ndarray:
    """x_d, ẋ_d, ẍ_d at times (N,), (N, 3, 3)."""
    instants = np.asarray(times, float)
    desired = np.zeros((len(instants), 3, 3))
    desired_motions(path, instants, desired)
    return desired
