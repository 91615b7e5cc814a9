"""Frequencies and damping ratios of a sampled free vibration, with 95 % intervals.

The signal is a sum of decaying oscillations, a slow background and white noise,

    y(t) = Σ_k exp(-σ_k t) (a_k cos ω_k t + b_k sin ω_k t) + polynomial(t) + noise,

fitted by least squares over (ω_k, σ_k) with the linear parts solved exactly (variable projection: Golub and Pereyra, SIAM J.
Numer. Anal. 10 (1973) 413). Modes are added while Schwarz's criterion improves. Modes too close together make up for one whose
frequency changes during the ring; it takes their place. Intervals are those of the linearised fit, widened by the error of this
model where the residual is not white noise (`evidence.shifts`).
"""

from functools import lru_cache

import numpy as np

from flexlab.analysis.identification import evidence
from flexlab.analysis.identification.estimates import Estimate, RingFit, RingMode
from flexlab.errors import StudyError
from flexlab.lapack import one_blas_thread

CONFIDENCE = 0.95
FEWEST_SAMPLES = 20
FEWEST_PERIODS = 2.0
"""Fewest periods within the samples by which an oscillation differs from the background."""
MOST_MODES = 3
GAIN = 10.0
"""Least gain of Schwarz's criterion for one more mode: very strong evidence (Kass and Raftery 1995)."""
BACKGROUND_ORDER = 2
START_RATIOS = (0.002, 0.01, 0.05, 0.2)
LARGEST_RATIO = 0.9
NOISE_ALONE = "no oscillation stands out from the noise"
NOT_ONE = "the samples hold something else as well, such as a second tap; say where one free ring begins and ends"
TOO_CLOSE = 1.5
"""Difference of two frequencies, over the resolution of the samples, up to which a fit does not tell two modes apart."""
SLOW, KNOWN, PARTLY = 5.0, 0.03, 1 / 3
"""Periods within the samples below which a mode beside a faster one may be a drift of the signal: always if it is the weaker one,
and else unless its damping ratio is known this closely, or to this part of itself."""
FITTED = 1e-9
"""Relative change at which a search ends; far smaller than any interval."""


@one_blas_thread()  # Threads slow small systems down.
def fit_ring(time: np.ndarray, signal: np.ndarray, most_modes: int = MOST_MODES) -> RingFit:
    """Fit a free vibration at `time` (N,), s, rising but not necessarily even. Raises `StudyError` for too few samples."""
    time, signal = np.asarray(time, dtype=float), np.asarray(signal, dtype=float)
    if len(time) < FEWEST_SAMPLES:
        raise StudyError(f"Too few samples to fit a vibration, {len(time)}: give {FEWEST_SAMPLES} at least.")
    scale = float(np.max(np.abs(signal - signal.mean())))
    if scale == 0 or not np.isfinite(scale):
        raise StudyError("The signal does not move: there is no vibration to fit.")
    tau, y = time - time[0], signal / scale
    found = np.empty((0, 2))
    criterion = _criterion(found, tau, y)
    for _ in range(most_modes):
        more = _with_another(found, tau, y)
        better = _criterion(more, tau, y)
        if better > criterion - GAIN and len(found):
            break
        found, criterion = more, better
        if _rest(found, tau, y).std() < evidence.BEST_TOLD:
            break
    problem = _reason(found, tau, y)
    if (last := evidence.clipped_until(y)) is not None:
        problem = (
            f"the signal is clipped until t = {time[last]:.6g} s; measure in a wider range, or begin the fit after that"
        )
    return _described(_merged(_without_noise(found, tau, y), tau, y), tau, y, scale, time, problem)


def _without_noise(modes: np.ndarray, tau: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Leave out modes that do not stand out from the residual: they fit its humps, or came before another was right."""
    if len(modes) == 1:
        return modes
    rest = _rest(modes, tau, y)
    is_white = evidence.is_white(rest)

    def stands_out(k: int) -> bool:
        others = np.delete(modes, k, axis=0)
        if is_white:
            return _criterion(others, tau, y) - _criterion(modes, tau, y) > GAIN
        return evidence.stands_out(_rest(others, tau, y), rest, 1)

    kept = [stands_out(k) for k in range(len(modes))]
    return modes if all(kept) or not any(kept) else _refined(modes[kept], tau, y)


def _merged(modes: np.ndarray, tau: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The modes, with one in place of modes that are too close together: a beam has no such modes.

    They make up for a frequency that changes during the ring, as when the arms move the beam, and none of them is the beam's.
    """
    kept, resolution = list[int](), 2 * np.pi / tau[-1]
    for k in np.argsort(-np.linalg.norm(_parts(modes, tau, y), axis=0)):
        near = (max(evidence.BESIDE * modes[one, 1], TOO_CLOSE * resolution) for one in kept)
        apart = (abs(modes[k, 0] - modes[one, 0]) > least for one, least in zip(kept, near, strict=True))
        if modes[k, 0] < SLOW * resolution or all(apart):  # Slow ones may follow a drift of the signal together.
            kept.append(k)
    return modes if len(kept) == len(modes) else _refined(modes[sorted(kept)], tau, y)


def _basis(modes: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Columns of the linear part for modes (m, 2) of ω, σ, (N, 2m + background)."""
    columns = []
    for omega, sigma in modes:
        decay = np.exp(-sigma * tau)
        columns += [decay * np.cos(omega * tau), decay * np.sin(omega * tau)]
    return np.column_stack([*columns, _background(tau.tobytes())])


@lru_cache(maxsize=1)
def _background(instants: bytes) -> np.ndarray:
    """Legendre polynomials at the `instants` tau of a fit, (N, background), computed once for its hundreds of residuals."""
    tau = np.frombuffer(instants)
    return np.polynomial.legendre.legvander(2 * tau / tau[-1] - 1, BACKGROUND_ORDER)


def _rest(modes: np.ndarray, tau: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The residual of the best linear combination."""
    Q, _ = np.linalg.qr(_basis(modes, tau))
    return y - Q @ (Q.T @ y)


def _criterion(modes: np.ndarray, tau: np.ndarray, y: np.ndarray) -> float:
    """Schwarz's criterion; less is better."""
    count = 4 * len(modes) + BACKGROUND_ORDER + 1
    return len(y) * np.log(max(np.mean(_rest(modes, tau, y) ** 2), evidence.BEST_TOLD**2)) + count * np.log(len(y))


def _with_another(modes: np.ndarray, tau: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The best fit with one more mode, starting from the strongest line of the residual."""
    even = np.linspace(0, tau[-1], len(tau))
    values = np.interp(even, tau, _rest(modes, tau, y))
    size = 8 * len(values)
    spectrum = np.abs(np.fft.rfft(values - values.mean(), size))
    spectrum[: int(FEWEST_PERIODS / 2 * 8)] = 0.0
    omega = 2 * np.pi * max(int(np.argmax(spectrum)), 1) / (size * (even[1] - even[0]))
    starts = [np.vstack([modes, [omega, ratio * omega]]) for ratio in START_RATIOS]
    return _refined(min(starts, key=lambda guess: float(np.sum(_rest(guess, tau, y) ** 2))), tau, y)


def _refined(start: np.ndarray, tau: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The best fit with as many modes, near `start`."""
    from scipy.optimize import least_squares  # Slow to load, and a lab that fits nothing does not need it.

    scale = start[:, :1].repeat(2, axis=1)
    low, high = np.zeros_like(start), np.column_stack([start[:, 0] * 4, start[:, 0] * 2])
    low[:, 0], low[:, 1] = start[:, 0] / 4, -0.05 * start[:, 0]
    solved = least_squares(
        lambda z: _rest(z.reshape(-1, 2) * scale, tau, y),
        (np.clip(start, low, high) / scale).ravel(),
        bounds=((low / scale).ravel(), (high / scale).ravel()),
        xtol=FITTED, ftol=FITTED, gtol=FITTED, x_scale="jac",
    )  # fmt: skip
    return solved.x.reshape(-1, 2) * scale


def _described(
    modes: np.ndarray, tau: np.ndarray, y: np.ndarray, scale: float, time: np.ndarray, problem: str
) -> RingFit:
    from scipy.special import stdtrit  # Slow to load.

    basis = _basis(modes, tau)
    linear = np.linalg.lstsq(basis, y, rcond=None)[0]
    rest = y - basis @ linear
    slopes = []
    for k in range(0, 2 * len(modes), 2):
        (a, b), (cosine, sine) = linear[k : k + 2], basis.T[k : k + 2]
        slopes += [tau * (b * cosine - a * sine), -tau * (a * cosine + b * sine)]
    J = np.column_stack([*slopes, basis])
    freedom = max(len(y) - J.shape[1], 1)
    variance = float(rest @ rest) / freedom
    size = np.linalg.norm(J, axis=0)
    covariance = variance * np.linalg.pinv((J / size).T @ (J / size)) / np.outer(size, size)
    factor = float(stdtrit(freedom, 0.5 + CONFIDENCE / 2))
    near = [max(1.0, density) for density, _ in _near(modes, tau, y)]
    exact = evidence.is_white(rest)
    moved = [np.zeros((1, 2))] * len(modes) if exact else evidence.shifts(modes, J, rest, linear, tau)
    found: list[RingMode] = []
    for k, (omega, sigma) in enumerate(modes):
        own = near[k] * covariance[2 * k : 2 * k + 2, 2 * k : 2 * k + 2]
        amplitude = float(np.hypot(linear[2 * k], linear[2 * k + 1])) * scale
        found.append(_mode(omega, sigma, own, factor, moved[k], amplitude, tau, problem))
    # A slow change of the background looks like part of a period; the first samples after a tap look like a fast mode.
    seen = [mode for mode in found if FEWEST_PERIODS <= mode.frequency.value * tau[-1] <= (len(tau) - 1) / 2]
    clear = [mode for mode in seen if mode.frequency.identifiable and mode.frequency.value * tau[-1] >= SLOW]
    usable = [mode for mode in seen if mode in clear or not clear or _is_known(mode.damping_ratio)]
    loudest = max(usable or found, key=lambda mode: mode.amplitude)
    told = clear if loudest in clear else [*clear, loudest]
    told.sort(key=lambda mode: mode.frequency.value)
    place = found.index(loudest)
    slow = [k for k, mode in enumerate(found) if mode not in told and mode.frequency.value < loudest.frequency.value]
    columns = [*(2 * k + part for k in slow for part in (0, 1)), *range(2 * len(modes), basis.shape[1])]
    background = basis[:, columns] @ linear[columns] * scale
    noise = float(np.sqrt(variance)) * scale
    halves = None if exact else evidence.unlike_halves(place, modes, J, rest, tau)
    return RingFit(tuple(told), noise, float(time[0]), float(time[-1]), len(time), background, problem, halves)


def _is_known(ratio: Estimate) -> bool:
    return ratio.high - ratio.value < max(KNOWN, PARTLY * ratio.value)


def _near(modes: np.ndarray, tau: np.ndarray, y: np.ndarray) -> list[tuple[float, float]]:
    """`local_density` of the residual near each mode; (1, 0) if the residual is white noise."""
    rest = _rest(modes, tau, y)
    if evidence.is_white(rest):
        return [(1.0, 0.0)] * len(modes)
    even, rings = np.linspace(0, tau[-1], len(tau)), _parts(modes, tau, y).sum(axis=1)
    left = np.interp(even, tau, rest)
    return [evidence.local_density(left, even[1], omega / (2 * np.pi), float(rings @ rings)) for omega in modes[:, 0]]


def _parts(modes: np.ndarray, tau: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Each mode's part of the best linear combination, (N, m)."""
    basis = _basis(modes, tau)
    scaled = basis * np.linalg.lstsq(basis, y, rcond=None)[0]
    return scaled[:, : 2 * len(modes)].reshape(len(y), -1, 2).sum(axis=2)


def _reason(modes: np.ndarray, tau: np.ndarray, y: np.ndarray) -> str:
    """Why samples with these modes are no free ring; empty if they are one."""
    rest = _rest(modes, tau, y)
    if rest.std() < evidence.BEST_TOLD:
        return ""
    if not evidence.stands_out(_rest(np.empty((0, 2)), tau, y), rest, len(modes)):
        return NOISE_ALONE
    uneven = evidence.unevenness(rest, _parts(modes, tau, y).sum(axis=1))
    if uneven > evidence.SEEN:
        return NOT_ONE
    density, excess = map(max, zip(*_near(modes, tau, y), strict=True))
    return NOT_ONE if excess > evidence.LEFT or (uneven > evidence.SEEN_NEAR and density > evidence.DENSE) else ""


def _mode(
    omega: float,
    sigma: float,
    own: np.ndarray,
    factor: float,
    moved: np.ndarray,
    amplitude: float,
    tau: np.ndarray,
    problem: str,
) -> RingMode:
    """A mode with intervals from its covariance `own`, widened by the largest of the changes `moved` (choices, 2)."""
    natural = float(np.hypot(omega, sigma))
    d_frequency = np.array([omega, sigma]) / natural / (2 * np.pi)
    d_ratio = np.array([-sigma * omega, omega**2]) / natural**3
    half_f, half_z = (
        factor * float(np.sqrt(max(d @ own @ d, 0.0))) + float(np.abs(moved @ d).max(initial=0.0))
        for d in (d_frequency, d_ratio)
    )
    f, zeta = natural / (2 * np.pi), float(sigma) / natural
    periods, rate = f * tau[-1], (len(tau) - 1) / tau[-1]
    held = f"the samples hold {min(periods, FEWEST_PERIODS - 0.1):.1f} of its periods"
    reasons = (
        (periods < FEWEST_PERIODS, f"{held}; {FEWEST_PERIODS:g} are needed"),
        (f > rate / 2, f"it lies beyond half the sample rate, {rate / 2:.4g} Hz"),
        (half_f > 0.5 * f, "the noise hides it"),
        (zeta > LARGEST_RATIO, "it is hardly an oscillation"),
    )
    further = (
        (zeta + half_z < 0, "the vibration grows"),
        (zeta - half_z <= 0, f"it is below {max(zeta + half_z, 0):.2g}, but the noise hides by how much"),
    )
    why = problem or next((reason for holds, reason in reasons if holds), "")
    why_not = why or next((reason for holds, reason in further if holds), "")
    return RingMode(
        Estimate(f, f - half_f, f + half_f, "Hz", why),
        Estimate(zeta, zeta - half_z, zeta + half_z, "", why_not),
        amplitude,
    )
