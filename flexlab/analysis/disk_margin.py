"""How much the motors may deviate before the loop is lost: the disk margin.

Seiler, Packard, Gahinet: An introduction to disk margins (IEEE Control Systems 40(5), 2020), symmetric disk (σ = 0): joint
torques may be multiplied by complex factors (1 + δ/2)/(1 - δ/2), |δ| < α, and the loop stays stable.
α = 1/max over ω of μ((S - T)/2), with μ the spectral radius where all motors have one factor, and bounded from above by
diagonal scalings where each has its own, so that α is never too large.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from flexlab.analysis.linearization import Linearization
from flexlab.analysis.loop_poles import NEUTRAL, by_state, held_plant, kept_memory
from flexlab.lapack import complex_schur

GRID = 300
"""Frequencies at which the loop is looked at, besides those around its poles."""
AROUND = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
"""Places around a pole's frequency, in its half-widths |Re|."""
SCALINGS = 12
"""Rounds of balancing the scaled matrix: each halves what is left, at least."""
LARGEST = 2.0
"""α of a loop that no gain and no phase can destroy."""


class Margin(NamedTuple):
    """Deviations that the loop survives."""

    alpha: float
    """α, 0 (unstable) to 2 (nothing destroys it)."""
    frequency: float
    """Where the loop is most easily lost, Hz; NaN of an unstable loop."""

    @property
    def gain(self) -> tuple[float, float]:
        """Factors from and to which gains may change."""
        if self.alpha >= LARGEST:
            return 0.0, np.inf
        return (2 - self.alpha) / (2 + self.alpha), (2 + self.alpha) / (2 - self.alpha)

    @property
    def phase(self) -> float:
        """Phase by which torques may lead or lag, °."""
        return float(np.degrees(2 * np.arctan(self.alpha / 2)))


class DiskMargin(NamedTuple):
    """Margins of the loop broken at its joint torques."""

    alike: Margin
    """All motors deviate by one factor: another gain, another delay."""
    each: Margin
    """Every motor deviates by a factor of its own, all at once in the worst way."""


def find_disk_margin(linear: Linearization, poles: np.ndarray) -> DiskMargin:
    """The disk margins of a loop with these poles (1/s)."""
    if np.any(poles.real > NEUTRAL):
        lost = Margin(0.0, np.nan)
        return DiskMargin(lost, lost)
    rates = _rates(linear, poles)
    loop = _torque_loop(linear, rates)
    identity = np.eye(linear.torque_count)
    # With H the torques answered to those in force, L = -H: S = (1 - H)⁻¹ and S - T = S (1 + H).
    deviation = np.linalg.solve(identity - loop, identity + loop) / 2
    alike = np.abs(np.linalg.eigvals(deviation)).max(axis=1)
    return DiskMargin(_margin(alike, rates), _margin(_structured_norm(deviation), rates))


def _margin(size: np.ndarray, rates: np.ndarray) -> Margin:
    worst = int(np.argmax(size))
    return Margin(float(min(LARGEST, 1 / size[worst])), float(rates[worst] / (2 * np.pi)))


def _rates(linear: Linearization, poles: np.ndarray) -> np.ndarray:
    """Angular frequencies that show every peak, 1/s."""
    period = linear.probe.original.controller.control_period
    size = np.abs(poles)
    size = size[size > NEUTRAL]
    low, high = (1.0, 1e3) if len(size) == 0 else (size.min() / 30, 10 * size.max())
    if period is not None:
        high = np.pi / period
    swinging = poles[poles.imag > 0]
    near = (swinging.imag[:, None] + np.abs(swinging.real)[:, None] * AROUND).ravel()
    rates = np.concatenate([np.geomspace(min(low, high / 10), high, GRID), near])
    return np.unique(rates[(rates > 0) & (rates <= high)])


def _torque_loop(linear: Linearization, rates: np.ndarray) -> np.ndarray:
    """H(ω), joint torques that the law asks for by those in force, (rates, arms · 3, arms · 3)."""
    controller, law, torques = linear.probe.original.controller, linear.law, linear.torque_count
    period, kept = controller.control_period, kept_memory(linear)
    A, B = held_plant(linear, period)
    triangle, basis = complex_schur(A)
    force = basis.conj().T @ B
    answer = by_state(linear, law.motion[:torques]) @ basis
    memory_in = by_state(linear, law.motion[torques + kept]) @ basis
    memory_out, memory_own = law.memory[:torques, kept], law.memory[np.ix_(torques + kept, kept)]
    seen = law.line.reshape(len(law.line), -1, torques)
    where = 1j * rates if period is None else np.exp(1j * rates * period)
    result = np.empty((len(rates), torques, torques), dtype=complex)
    shifted, diagonal = -triangle, np.diag_indices_from(triangle)
    for k, z in enumerate(where):
        shifted[diagonal] = z - triangle[diagonal]
        motion = solve_triangular(shifted, force, check_finite=False)
        # What the law asked for earlier is known to it: the torques in force deviate from that.
        ago = np.tensordot(seen, z ** np.arange(-seen.shape[1], 0), (1, 0))
        asked, known = answer @ motion, ago[:torques]
        if len(kept):
            slope = z if period is None else z - 1
            told = np.hstack([memory_in @ motion, ago[torques + kept]])
            through = memory_out @ np.linalg.solve(slope * np.eye(len(kept)) - memory_own, told)
            asked, known = asked + through[:, :3], known + through[:, 3:]
        if seen.shape[1]:
            asked = np.linalg.solve(np.eye(torques) - known, asked)
        late = 1.0 if period is None else z**-controller.input_delay
        result[k] = late * asked @ linear.plant.input[:3]
    return result


def _structured_norm(matrices: np.ndarray) -> np.ndarray:
    """Upper bound of μ for independent channels: σ_max(D M D⁻¹) with D that balances rows and columns, (rates,)."""
    scale = np.ones(matrices.shape[:2])
    power = np.abs(matrices) ** 2
    power[:, *np.diag_indices(matrices.shape[1])] = 0
    tiny = np.finfo(float).tiny
    for _ in range(SCALINGS):
        for channel in range(matrices.shape[1]):
            row = (power[:, channel] / scale**2).sum(axis=1)
            column = (power[:, :, channel] * scale**2).sum(axis=1)
            able = (row > tiny) & (column > tiny)
            scale[able, channel] = (column[able] / row[able]) ** 0.25
    return np.linalg.norm(matrices * scale[:, :, None] / scale[:, None, :], ord=2, axis=(1, 2))
