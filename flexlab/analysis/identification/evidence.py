"""What samples say about a ring besides its fit: where it begins, whether it exceeds noise, how far off the fit may be.

The motion of a beam in moving arms under a nonlinear law is not a sum of a few decaying oscillations. The residual is then
what that sum leaves out rather than noise, and an interval computed from noise, which shrinks with the number of samples, is
too narrow. The samples show this error in how much a mode changes with the part of the ring that is fitted, and with weak or
near modes beside it, which take up what another mode leaves (`shifts`).
"""

from typing import NamedTuple

import numpy as np

BLOCKS, FEWEST_IN_BLOCK = 64, 8
"""Number of blocks in the search for a ring's beginning, and fewest samples in a block."""
AFTER = 3
"""Number of blocks after a beginning that are compared with all blocks before it."""
JUMP = 9.0
"""Least power at a ring's beginning over the power before: three times the amplitude."""
LOUD = 0.3
"""Least power at a ring's beginning over that of the loudest block."""
FINER = 8
"""Points per line of the spectrum that gives a ring's period."""
HALF = 0.5
"""Height over the highest at which a jump lies that a filter has spread."""
HIGH = 0.5
"""Least height of a ring's first peak over the highest of the first few."""
WHITE = 0.01
"""Significance level of the test for white noise."""
LAGS = 20
NEAR = (0.8, 1.25)
"""Range of frequencies, over a mode's, that counts as near the mode."""
PARTS, FEWEST_IN_PART = 8, 25
"""Number of parts whose residual power is compared, and fewest samples in a part."""
UNEVEN = 3.0
"""Residual power in the loudest part over that in the median part, from which the residual is no noise floor."""
SEEN, SEEN_NEAR, DENSE = 0.05, 0.01, 5.0
"""Residual power over the modes' power in the loudest part, from which there is no free ring: SEEN always, SEEN_NEAR if the
residual's spectrum near a mode is more than DENSE times its average."""
LEFT = 0.1
"""Excess energy of the residual near a mode over the energy of all modes, from which there is no free ring."""
BEST_TOLD = 1e-12
"""Relative residual below which samples are exact to rounding."""
STANDS_OUT = 30.0
"""Least gain in Schwarz's criterion of all modes over noise alone: a search over frequencies also finds chance lines."""
FEWEST_CLIPPED, MORE = 3, 5
"""Fewest clipped peaks, and least ratio of samples at the clipped value to samples at the next smaller one."""
HELD = 1.5
"""Fewest samples at the clipped value per clipped peak that follow an equal one, if samples are rounded."""
FEWEST_OF_EXACT, HELD_OF_EXACT, SMALLER_OF_EXACT = 2, 2, 5
"""Fewest clipped peaks, fewest such samples in all, and how many next smaller values are compared, of samples with so many digits
that hardly any two are equal."""


def clipped_until(signal: np.ndarray) -> int | None:
    """Index of the last clipped sample of a signal; None if its peaks are not clipped.

    Peaks of a ring also share a value if samples are rounded, but the next smaller value is then nearly as frequent.
    """
    last, is_exact = [], np.median(np.unique(signal, return_counts=True)[1]) == 1
    fewest, smaller = (FEWEST_OF_EXACT, SMALLER_OF_EXACT) if is_exact else (FEWEST_CLIPPED, 1)
    # Both sides together if the limits are the same, as half of the peaks may be too few.
    for side in (signal, -signal, np.abs(signal)) if is_exact else (signal, -signal):
        counts = np.unique(side, return_counts=True)[1]
        at_limit = side == side.max()
        peaks = np.count_nonzero(np.diff(at_limit, prepend=False) & at_limit)
        next_smaller = counts[-1 - smaller : -1].max(initial=1)
        held = HELD_OF_EXACT if is_exact else HELD * peaks
        if peaks >= fewest and counts[-1] >= MORE * next_smaller and counts[-1] - peaks >= held:
            last.append(int(np.flatnonzero(at_limit)[-1]))
    return max(last, default=None)


def ring_begins(signal: np.ndarray) -> int:
    """Index of a ring's first peak: after the last quiet part, or else in all samples; 0 if there are too few.

    In loud noise, which hides that peak, it is half a period after the beginning. Even a few quiet samples before the peak would
    be fitted by strongly damped modes, which the ring does not have.
    """
    size = max(FEWEST_IN_BLOCK, len(signal) // BLOCKS)
    count = len(signal) // size
    if count < 2 + AFTER:
        return 0
    blocks = signal[: count * size].reshape(count, size)
    block = _jump(np.mean(_about_line(blocks) ** 2, axis=1))
    if block is not None:
        quiet = float(np.median(signal[: block * size]))
        return block * size + int(np.argmax(np.abs(signal[block * size : (block + AFTER) * size] - quiet)))
    line, period = _line(signal)
    block = _jump(np.mean(np.abs(line[: count * size].reshape(count, size)) ** 2, axis=1))
    if block is None:
        return _first_peak(signal, 2 * size, period)
    # A filter without delay spreads a jump to both sides: half its height is where it is. The loudest sample near it is no better
    # a beginning: it is where noise adds to the ring, and the fit then misses the truth more often than its interval says.
    seen = np.abs(line[(block - 1) * size :])
    return (block - 1) * size + int(np.argmax(seen >= HALF * seen.max())) + period // 2


def _about_line(blocks: np.ndarray) -> np.ndarray:
    """Deviations from each row's own straight line, (count, size)."""
    ramp, middle = np.linspace(-1, 1, blocks.shape[1]), blocks - blocks.mean(axis=1, keepdims=True)
    return middle - (middle @ ramp / (ramp @ ramp))[:, None] * ramp


def _jump(power: np.ndarray) -> int | None:
    """The block, by its `power`, before which all is quiet and from which on a ring is loud; None if there is none."""
    count = len(power)
    before = np.cumsum(power)[1:-AFTER] / np.arange(2, count - AFTER + 1)
    after = np.convolve(power, np.full(AFTER, 1 / AFTER), "valid")[2:]
    loud = (after >= LOUD * power.max()) & (after >= JUMP * before) & (after > 0)
    if not loud.any():
        return None
    gain = np.where(loud, after / np.maximum(before, after.max() * BEST_TOLD), 0.0)
    return 2 + int(np.argmax(gain))


def _line(signal: np.ndarray) -> tuple[np.ndarray, int]:
    """(analytic signal of the strongest line and what is near it, (N,); samples in a period of that line).

    Most of a white noise is elsewhere in the spectrum, so that a ring begins visibly in it even if noise is nearly as loud.
    """
    count = len(signal)
    place = np.linspace(-1, 1, count)
    rings = signal - np.polynomial.Polynomial.fit(place, signal, 2)(place)
    spectrum = np.fft.fft(rings, FINER * count)
    spectrum[:FINER] = spectrum[FINER * count // 2 :] = 0.0
    strongest = max(int(np.argmax(np.abs(spectrum))), 1)
    near = np.arange(len(spectrum)) / strongest
    spectrum[(near < NEAR[0]) | (near > NEAR[1])] = 0.0
    return 2 * np.fft.ifft(spectrum)[:count], max(2, round(FINER * count / strongest))


def _first_peak(signal: np.ndarray, quiet: int, period: int) -> int:
    """Index of the first peak of a signal that rings from its beginning, or after at most `quiet` samples."""
    count = len(signal)
    # The distance from the mean over a period around each sample; at the ends, over the nearest whole period.
    first = np.clip(np.arange(count) - period // 2, 0, max(count - period, 0))
    last = np.minimum(first + period, count)
    total = np.concatenate([[0.0], np.cumsum(signal - signal[0])])
    size = np.abs(signal - signal[0] - (total[last] - total[first]) / (last - first))
    seen = size[: quiet + 2 * period]
    high = int(np.argmax(seen >= HIGH * seen.max()))
    return high + int(np.argmax(size[high : high + period // 2 + 2]))


def stands_out(signal: np.ndarray, rest: np.ndarray, modes: int) -> bool:
    """Whether modes that leave the residual `rest` of `signal` exceed noise by Schwarz's criterion.

    With and without the modes, noise is autoregressive of second order, like a structure under random impacts; that covers
    drifts, wandering hums and bands of noise.
    """
    before, left = (max(_unforeseen(each), BEST_TOLD**2) for each in (signal, rest))
    return bool(len(rest) * np.log(before / left) - 4 * modes * np.log(len(rest)) >= STANDS_OUT)


def _unforeseen(rest: np.ndarray) -> float:
    """Mean square error of the best prediction of each value by the two before it."""
    known = np.column_stack([rest[1:-1], rest[:-2]])
    told = np.linalg.lstsq(known, rest[2:], rcond=None)[0]
    return float(np.mean((rest[2:] - known @ told) ** 2))


def is_white(rest: np.ndarray) -> bool:
    """Whether the residual is white noise (Ljung and Box, Biometrika 65 (1978) 297), or no more than rounding."""
    from scipy.special import chdtrc  # Slow to load.

    if rest.std() < BEST_TOLD:
        return True
    count, lags = len(rest), min(LAGS, len(rest) // 4)
    power = float(rest @ rest)
    alike = np.array([rest[lag:] @ rest[:-lag] for lag in range(1, lags + 1)]) / power
    Q = count * (count + 2) * np.sum(alike**2 / (count - np.arange(1, lags + 1)))
    return bool(chdtrc(lags, Q) >= WHITE)


def unevenness(rest: np.ndarray, rings: np.ndarray) -> float:
    """Residual power over the power of `rings`, the modes' part, where the residual is loudest; 0 for a noise floor.

    A noise floor is equally strong everywhere; the residual of a second tap or of a burst of noise is not.
    """
    count = min(PARTS, len(rest) // FEWEST_IN_PART)
    if count < 3:
        return 0.0
    left, rung = (np.array([np.mean(part**2) for part in np.array_split(each, count)]) for each in (rest, rings))
    worst = int(np.argmax(left))
    return float(left[worst] / rung[worst]) if left[worst] >= UNEVEN * np.median(left) else 0.0


def local_density(rest: np.ndarray, step: float, frequency: float, own: float) -> tuple[float, float]:
    """(spectral density of the residual near `frequency` over its mean, excess energy there as a share of `own`).

    `step`: s between samples; `own`: energy of the modes. The excess is the energy that the density elsewhere does not explain.
    """
    power = np.abs(np.fft.rfft(rest)[1:]) ** 2 * 2 / len(rest)
    f = np.fft.rfftfreq(len(rest), step)[1:]
    wide = max(0.25 * frequency, 3 * f[0])
    near = (f >= min(NEAR[0] * frequency, frequency - wide)) & (f <= max(NEAR[1] * frequency, frequency + wide))
    if not near.any() or near.all():
        return 1.0, 0.0
    elsewhere = float(np.median(power[~near])) / np.log(2)
    excess = float(power[near].sum()) - elsewhere * int(near.sum())
    return float(power[near].mean() / power.mean()), max(excess, 0.0) / own


FEWEST_IN_HALF = 8
"""Fewest samples in half a ring."""
WEAK = 0.1
"""Amplitude over a mode's, up to which another mode is weak, so that a fit without it shows this mode's error."""
BESIDE = 4.0
"""Difference of two modes' frequencies, over the larger decay rate, up to which they are near: a fit hardly separates them."""
SINGULAR = 1e-10
"""Relative singular value below which a direction is not determined."""


def shifts(
    modes: np.ndarray, jacobian: np.ndarray, rest: np.ndarray, linear: np.ndarray, tau: np.ndarray
) -> list[np.ndarray]:
    """For each mode of `modes` (m, 2): first-order changes of (ω, σ), 1/s, if other samples or modes are fitted, (choices, 2).

    `jacobian` (N, 4 m + b): derivatives by the modes' ω and σ, then by the `linear` factors (2 m + b) of the best fit; `rest`
    (N,): its residual; `tau` (N,): time from the first sample, s.
    """
    found = (
        [half.change for half in halves(k, modes, jacobian, rest, tau)]
        + _without_others(k, modes, jacobian, rest, linear)
        for k in range(len(modes))
    )
    return [np.array(changes).reshape(-1, 2) for changes in found]


CHANGES = 1e-3
"""Relative change of a frequency from the first to the second half of a ring, from which it is told."""
SURELY = 4.0
"""Difference of two frequencies, over its standard deviation, from which it is no chance."""
WHOLE = 2.0
"""Fewest periods in half a ring with which its frequency is told."""


class Half(NamedTuple):
    """What half of a ring says of a mode."""

    change: np.ndarray
    """First-order changes of ω and σ if only this half is fitted, 1/s, (2,)."""
    error: float
    """Standard deviation of the change of ω that noise alone would make, 1/s."""
    span: float
    """Its length, s."""


def halves(k: int, modes: np.ndarray, jacobian: np.ndarray, rest: np.ndarray, tau: np.ndarray) -> list[Half]:
    """The first and the second half of the energy of mode k, with the other modes fixed; those with enough samples."""
    own, count = jacobian[:, _columns(k, len(modes))], len(tau)
    power = np.cumsum(np.exp(-2 * modes[k, 1] * (tau - tau[-1] * (modes[k, 1] < 0))))
    middle = max(FEWEST_IN_HALF, int(np.searchsorted(power, power[-1] / 2)))
    parts = (slice(0, middle), slice(middle, count))
    return [_half(own[rows], rest[rows], tau[rows], modes[k, 0]) for rows in parts if len(tau[rows]) >= FEWEST_IN_HALF]


def _half(own: np.ndarray, rest: np.ndarray, tau: np.ndarray, omega: float) -> Half:
    change = _step(own, rest)
    left = rest - own @ change
    step = (tau[-1] - tau[0]) / (len(tau) - 1)
    density = max(1.0, local_density(left, step, omega / (2 * np.pi), 1.0)[0])
    size = np.linalg.norm(own, axis=0)
    spread = np.linalg.pinv((own / size).T @ (own / size))[0, 0] / size[0] ** 2
    return Half(change[:2], float(np.sqrt(density * np.mean(left**2) * spread)), float(tau[-1] - tau[0]))


def unlike_halves(
    k: int, modes: np.ndarray, jacobian: np.ndarray, rest: np.ndarray, tau: np.ndarray
) -> tuple[float, float] | None:
    """The frequencies of mode k in the `halves` of its energy, Hz, if they differ by more than noise makes them; else None.

    None also for a strongly damped mode, of which half rings for less than `WHOLE` periods.
    """
    found = halves(k, modes, jacobian, rest, tau)
    if len(found) < 2 or min(half.span for half in found) * modes[k, 0] / (2 * np.pi) < WHOLE:
        return None
    first, second = (float(np.hypot(*(modes[k] + half.change))) / (2 * np.pi) for half in found)
    by_noise = SURELY * float(np.hypot(found[0].error, found[1].error)) / (2 * np.pi)
    return (first, second) if abs(second - first) > max(CHANGES * (first + second) / 2, by_noise) else None


def _without_others(
    k: int, modes: np.ndarray, jacobian: np.ndarray, rest: np.ndarray, linear: np.ndarray
) -> list[np.ndarray]:
    """Changes of one mode if each weaker mode that is weak or near is left out in turn, by one Gauss-Newton step."""
    count, found = len(modes), []
    amplitude = np.hypot(linear[0 : 2 * count : 2], linear[1 : 2 * count : 2])
    for other in range(count):
        near = abs(modes[other, 0] - modes[k, 0]) < BESIDE * max(modes[other, 1], modes[k, 1])
        if other == k or amplitude[other] >= amplitude[k] * (1 if near else WEAK):
            continue
        places = _columns(other, count)
        target = rest + jacobian[:, places[2:]] @ linear[2 * other : 2 * other + 2]
        first = 2 * k - 2 * (other < k)
        found.append(_step(np.delete(jacobian, places, axis=1), target)[first : first + 2])
    return found


def _columns(k: int, count: int) -> list[int]:
    """The Jacobian's columns of mode k of `count`: ω, σ and the two linear factors."""
    return [2 * k, 2 * k + 1, 2 * (count + k), 2 * (count + k) + 1]


def _step(jacobian: np.ndarray, rest: np.ndarray) -> np.ndarray:
    size = np.maximum(np.linalg.norm(jacobian, axis=0), np.finfo(float).tiny)
    return np.linalg.lstsq(jacobian / size, rest, rcond=SINGULAR)[0] / size
