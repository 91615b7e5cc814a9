"""How far a fitted ring may be from what rings: of samples whose residual is no noise, but what the sum of modes leaves out.

A beam that arms carry on, under a law that is not linear, is no sum of a few decaying oscillations. The interval of noise, which
shrinks with the number of samples, then says too much. What the samples tell of that error is how much a mode depends on
which part of its ring is fitted, and on weak or near modes beside it, which take up what is left of another.
"""

import numpy as np

FEWEST_IN_HALF = 8
"""Least samples of a half of a ring."""
WEAK = 0.1
"""Amplitude, over a mode's, of another whose absence tells of this mode's error."""
NEAR = 4.0
"""Difference of frequencies, over the larger decay rate, up to which two modes share what they ring."""
SINGULAR = 1e-10
"""Relative singular value below which a direction is not determined."""


def shifts(
    modes: np.ndarray, jacobian: np.ndarray, rest: np.ndarray, linear: np.ndarray, tau: np.ndarray
) -> list[np.ndarray]:
    """Of each mode of `modes` (m, 2), the changes of (ω, σ), 1/s, that other choices make, to first order, each (choices, 2).

    `jacobian` (N, 4 m + b): by the modes' ω and σ, then by the `linear` factors (2 m + b) of the best fit; `rest` (N,): its
    residual; `tau` (N,): s from the first sample.
    """
    found = (
        [*_halves(k, modes, jacobian, rest, tau), *_without_others(k, modes, jacobian, rest, linear)]
        for k in range(len(modes))
    )
    return [np.array(changes).reshape(-1, 2) for changes in found]


def _halves(k: int, modes: np.ndarray, jacobian: np.ndarray, rest: np.ndarray, tau: np.ndarray) -> list[np.ndarray]:
    """Changes of one mode, the others as they are, by the first and the second half of its power alone."""
    own, count = jacobian[:, _columns(k, len(modes))], len(tau)
    power = np.cumsum(np.exp(-2 * modes[k, 1] * (tau - tau[-1] * (modes[k, 1] < 0))))
    middle = max(FEWEST_IN_HALF, int(np.searchsorted(power, power[-1] / 2)))
    halves = (slice(0, middle), slice(middle, count))
    return [_step(own[rows], rest[rows])[:2] for rows in halves if len(tau[rows]) >= FEWEST_IN_HALF]


def _without_others(
    k: int, modes: np.ndarray, jacobian: np.ndarray, rest: np.ndarray, linear: np.ndarray
) -> list[np.ndarray]:
    """Changes of one mode as each weaker one that is weak or near is left out, by one step of Gauss and Newton."""
    count, found = len(modes), []
    amplitude = np.hypot(linear[0 : 2 * count : 2], linear[1 : 2 * count : 2])
    for other in range(count):
        near = abs(modes[other, 0] - modes[k, 0]) < NEAR * max(modes[other, 1], modes[k, 1])
        if other == k or amplitude[other] >= amplitude[k] * (1 if near else WEAK):
            continue
        places = _columns(other, count)
        target = rest + jacobian[:, places[2:]] @ linear[2 * other : 2 * other + 2]
        first = 2 * k - 2 * (other < k)
        found.append(_step(np.delete(jacobian, places, axis=1), target)[first : first + 2])
    return found


def _columns(k: int, count: int) -> list[int]:
    """The columns of mode k of `count`: by ω, σ and its two linear factors."""
    return [2 * k, 2 * k + 1, 2 * (count + k), 2 * (count + k) + 1]


def _step(jacobian: np.ndarray, rest: np.ndarray) -> np.ndarray:
    size = np.maximum(np.linalg.norm(jacobian, axis=0), np.finfo(float).tiny)
    return np.linalg.lstsq(jacobian / size, rest, rcond=SINGULAR)[0] / size
