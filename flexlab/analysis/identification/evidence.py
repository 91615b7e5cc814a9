"""Whether samples hold a ring at all: where it begins, whether it is more than noise, and what is left when it is taken away."""

import numpy as np
from scipy.stats import chi2

BLOCKS, FEWEST_IN_BLOCK = 64, 8
"""Into which samples are parted to look for a beginning; samples that each holds at least."""
AFTER = 3
"""Blocks after a beginning that are compared with all before it."""
JUMP = 9.0
"""Times the power before it that a ring begins with: an amplitude of three."""
LOUD = 0.3
"""Share of the loudest block's power that it has then."""
WHITE = 0.01
"""Probability below which neighbours that are this much alike are no chance."""
LAGS = 20
NEAR = (0.8, 1.25)
"""Times a mode's frequency within which what is left counts as its own."""
PARTS, FEWEST_IN_PART = 8, 25
"""Of the samples, among which what is left is compared; samples that each holds at least."""
UNEVEN = 3.0
"""Power of what is left in one part over that in most from which it is no noise floor."""
SEEN, SEEN_NEAR, DENSE = 0.05, 0.01, 5.0
"""That power over the modes' there from which they are no free ring: anywhere in the spectrum, or where it is so many times
denser near the modes' frequencies than on average."""
LEFT = 0.1
"""Share of the modes' energy beyond which what is left near them says that they are no free ring."""
BEST_TOLD = 1e-12
"""Relative noise below which the samples are exact to rounding."""
STANDS_OUT = 30.0
"""Gain of Schwarz's criterion by all modes together over noise: a search over all frequencies finds chance lines."""


def ring_begins(signal: np.ndarray) -> int:
    """Index of the first sample of a ring, its first peak; 0 where nothing quieter comes before it."""
    size = max(FEWEST_IN_BLOCK, len(signal) // BLOCKS)
    count = len(signal) // size
    if count < 2 + AFTER:
        return 0
    power = _bent(signal[: count * size].reshape(count, size))
    before = np.cumsum(power)[1:-AFTER] / np.arange(2, count - AFTER + 1)
    after = np.convolve(power, np.full(AFTER, 1 / AFTER), "valid")[2:]
    loud = (after >= LOUD * power.max()) & (after >= JUMP * before) & (after > 0)
    if not loud.any():
        return 0
    gain = np.where(loud, after / np.maximum(before, after.max() * BEST_TOLD), 0.0)
    block = 2 + int(np.argmax(gain))
    quiet = float(np.median(signal[: block * size]))
    peak = int(np.argmax(np.abs(signal[block * size : (block + AFTER) * size] - quiet)))
    return block * size + peak


def _bent(blocks: np.ndarray) -> np.ndarray:
    """Mean square of each block (B, n) about its own straight line, (B,)."""
    place = np.linspace(-1, 1, blocks.shape[1])
    level = blocks - blocks.mean(axis=1, keepdims=True)
    slope = level @ place / (place @ place)
    return np.mean((level - slope[:, None] * place) ** 2, axis=1)


def stands_out(signal: np.ndarray, rest: np.ndarray, modes: int) -> bool:
    """Whether modes that leave `rest` of `signal` are more than noise: Schwarz's criterion gains by them.

    Noise may remember its last two values in both cases, as what random knocks keep a structure doing does: without modes
    that explains drifts, hums that wander, and bands of noise.
    """
    before, left = (max(_unforeseen(each), BEST_TOLD**2) for each in (signal, rest))
    return bool(len(rest) * np.log(before / left) - 4 * modes * np.log(len(rest)) >= STANDS_OUT)


def _unforeseen(rest: np.ndarray) -> float:
    """Mean square of what of each value its two neighbours before do not tell."""
    known = np.column_stack([rest[1:-1], rest[:-2]])
    told = np.linalg.lstsq(known, rest[2:], rcond=None)[0]
    return float(np.mean((rest[2:] - known @ told) ** 2))


def is_white(rest: np.ndarray) -> bool:
    """Whether what is left is white noise: Ljung and Box, Biometrika 65 (1978) 297."""
    count, lags = len(rest), min(LAGS, len(rest) // 4)
    power = float(rest @ rest)
    alike = np.array([rest[lag:] @ rest[:-lag] for lag in range(1, lags + 1)]) / power
    Q = count * (count + 2) * np.sum(alike**2 / (count - np.arange(1, lags + 1)))
    return bool(chi2.sf(Q, lags) >= WHITE)


def unevenness(rest: np.ndarray, rings: np.ndarray) -> float:
    """Power of what is left over the modes', `rings`, where it is loudest; 0 where it is as strong everywhere.

    A noise floor is; what is left is not after a second tap, nor in a burst of noise.
    """
    count = min(PARTS, len(rest) // FEWEST_IN_PART)
    if count < 3:
        return 0.0
    left, rung = (np.array([np.mean(part**2) for part in np.array_split(each, count)]) for each in (rest, rings))
    worst = int(np.argmax(left))
    return float(left[worst] / rung[worst]) if left[worst] >= UNEVEN * np.median(left) else 0.0


def local_density(rest: np.ndarray, step: float, frequency: float, own: float) -> tuple[float, float]:
    """(density of what is left around `frequency` over white noise of the same power, excess of energy there).

    `step`: s between samples; `own`: energy of the modes. The second is a share of it: what is left near the modes, beyond what
    noise elsewhere in the spectrum explains.
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
