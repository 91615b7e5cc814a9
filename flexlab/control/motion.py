"""The desired motion as kernels take it: a path, its smooth start, its input shaper, and the transition after a live change.

At time t ≥ 0 the target is Σ A_j x(t - t_j) + d(t): x is the path, entered at growing speed over `ramp` s (`path_time`), A_j and
t_j are the impulses of the input shaper, and d is what a live change left over (`transition`). Before t = 0 every path stands at
x(0), periodic ones too: an impulse's copy begins at its own time.

Input shapers convolve a motion with a few impulses, so that the vibrations of its copies cancel. For a mode of frequency ω,
rad/s, and damping ratio ζ: k = exp(-ζπ/√(1-ζ²)), T_d = 2π/(ω√(1-ζ²)). Amplitudes add up to 1, so that the motion ends at the
same place, later by the last impulse's time. Singer & Seering, J. Dyn. Sys. Meas. Control 112(1), 1990; Singhose, Seering &
Singer, J. Mech. Design 116(2), 1994 (extra-insensitive).
"""

import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlab.compiled import call_kernel, compiled, inlined
from flexlab.numerics.elementary import exp

Shaper = Literal["none", "zv", "zvd", "ei-shaper"]
"""No shaper, zero vibration, zero vibration and derivative, extra-insensitive."""
TOLERATED = 0.05
"""V: share of the unshaped vibration that the extra-insensitive shaper leaves at ω, for a band twice as wide."""
_AMPLITUDES: dict[str, Callable[[float], list[float]]] = {
    "none": lambda k: [],
    "zv": lambda k: [1.0, k],
    "zvd": lambda k: [1.0, 2 * k, k * k],
    "ei-shaper": lambda k: [(1 + TOLERATED) / 4, (1 - TOLERATED) * k / 2, (1 + TOLERATED) * k * k / 4],
}
"""Shaper → relative amplitudes of its impulses, half a period T_d apart."""


def impulses(shaper: str, omega: float, zeta: float) -> np.ndarray:
    """A_j, 1, and t_j, s, of a shaper for a mode of ω rad/s and damping ratio ζ in [0, 1), (impulses, 2)."""
    root = math.sqrt(1 - zeta * zeta)
    amplitudes = np.array(_AMPLITUDES[shaper](float(exp(-zeta * np.pi / root))))
    times = np.arange(len(amplitudes)) * np.pi / (omega * root)
    return np.stack([amplitudes / amplitudes.sum(), times], axis=1) if len(amplitudes) else np.zeros((0, 2))


def residual(shaped: np.ndarray, omega: float) -> float:
    """Vibration that impulses (k, 2) leave in an undamped mode of ω rad/s, as a share of that of one impulse, 1."""
    return float(abs(np.sum(shaped[:, 0] * np.exp(1j * omega * shaped[:, 1]))))


NO_ROWS = np.zeros((0, 1))
"""The table of a path that has none."""
NO_SHAPER = np.zeros((0, 2))
NO_TRANSITION = np.zeros(11)
NO_DISCONTINUITIES = np.zeros(0)
INSIDE = 1e-14
"""How far inside a step its ends are evaluated, s per second since t = 0: ten times the rounding of instants. A step that ends at
a jump of the acceleration must not see what comes after it, nor one that begins there what was before: its order falls to one."""


class DesiredMotion(NamedTuple):
    """A path as kernels take it."""

    kernel: int
    """Address of the path's kernel."""
    numbers: np.ndarray
    """The path's record, flat."""
    rows: np.ndarray
    """The path's table, (rows, columns); most paths have no rows."""
    plain: bool = True
    """Whether the path has no ramp, shaper or transition."""
    ramp: float = 0.0
    """Time over which the path is entered, s."""
    impulses: np.ndarray = NO_SHAPER
    """A_j and t_j, s, of the shaper, (impulses, 2); none: unshaped."""
    transition: np.ndarray = NO_TRANSITION
    """Instant and duration, s, then the pose, rate and acceleration that are left over at that instant, (11,)."""
    bending: float = 0.0
    """Share of the quasi-static bending's force that is fed forward, 1 (`control.law_kernels`)."""
    inside: float = 0.0
    """How far inside a step its first and last stage evaluate a path whose acceleration jumps, s (`INSIDE`); else 0."""
    discontinuities: np.ndarray = NO_DISCONTINUITIES
    """Instants at which velocity, acceleration or jerk jump, s, in order: there a step has to end (`sim.stepping`)."""


@inlined
def path_time(t, ramp):
    """Time along the path at time t, s, and its first and second derivative, 1 and 1/s.

    The rate grows from 0 to 1 over `ramp` as 10τ³ - 15τ⁴ + 6τ⁵: the path keeps its shape and lags by half the `ramp`. 0 at t < 0.
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
    """The time, s, at which a path entered over `ramp` reaches its own time `along`, s: the inverse of `path_time`."""
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
    # Three quintics: initial value, slope or curvature of 1 and the other two zero; all end with all three zero.
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
