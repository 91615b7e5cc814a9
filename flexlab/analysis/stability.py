"""Stability of a linearised loop: its poles, and the disk margin of its motors.

Poles are those of the differential equations, or of the map from one control instant to the next if the controller is sampled.
Between instants the plant moves by the exact exponential of its equations under held joint torques; at an instant the law
answers its measurements, and its torques join those on their way. An eigenvalue z of that map is the pole log(z)/T_c.

The disk margin is the largest deviation of the motors under which the loop stays stable. Seiler, Packard, Gahinet: An
introduction to disk margins (IEEE Control Systems 40(5), 2020), symmetric disk (σ = 0): joint torques may be multiplied by
complex factors (1 + δ/2)/(1 - δ/2), |δ| < α. α = 1/max over ω of μ((S - T)/2), where μ is the spectral radius if all motors
have one factor, and is bounded from above by diagonal scalings if each has its own, so that α is never too large.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from flexlab.analysis.linearization import Linearization, first_order
from flexlab.control.observers.believed_plant import hold
from flexlab.lapack import complex_schur, eigenvectors

DEADBEAT = 1e-5
"""|z| below which a pole is a rounding error: it belongs to torques without any effect."""
AT_REST, ALIKE = 1e-6, 1e-6
"""|Re p|, 1/s, below which a pole neither decays nor grows, and |Im p|/|p| below which it is one of two equal real poles:
rounding errors reach 1e-11 and 1e-8, and differ from processor to processor."""
NEUTRAL = 1e-3
"""Growth, 1/s, below which a pole counts as neutral: above all rounding, and less than 6 % in a minute."""
INTERNAL = 1e-9
"""Share of the plant's input below which the effect of internal forces on the beam is a rounding error."""


class Poles(NamedTuple):
    """Poles by magnitude."""

    value: np.ndarray
    """1/s, complex, (poles,), without what rounding errors make of 0 and of equal real poles."""
    share: np.ndarray
    """Participation of pose, each beam mode, the law's memory, and torques on their way or late, in this order of columns;
    each row adds up to 1, (poles, n_m + 3)."""


def beam_scale(linear: Linearization) -> np.ndarray:
    """Factors on (x, η, ẋ, η̇) that make its parts similar in size, as ωη and η̇, (2 n,)."""
    n = linear.probe.mode_count
    return np.concatenate([np.ones(3), linear.omega, np.ones(3 + n)])


def acting(linear: Linearization) -> tuple[np.ndarray, np.ndarray]:
    """The plant's input matrix as two factors, (n, acting) and (acting, torques).

    Torques act as three forces on the pose, the rows of the second factor. The arms' internal forces add rows only if the beam is
    bent at rest and feels the force along it.
    """
    to_pose, to_beam = linear.plant.input[:3], linear.plant.input[3:]
    by_pose = to_beam @ np.linalg.pinv(to_pose)
    shapes, sizes, rows = np.linalg.svd(to_beam - by_pose @ to_pose)
    further = int(np.sum(sizes > INTERNAL * np.linalg.norm(linear.plant.input)))
    forces = np.block([[np.eye(3), np.zeros((3, further))], [by_pose, shapes[:, :further] * sizes[:further]]])
    return forces, np.vstack([to_pose, rows[:further]])


def held_plant(linear: Linearization, period: float | None) -> tuple[np.ndarray, np.ndarray]:
    """A and B of the scaled state for the inputs of `acting`: of dz/dt, or over a period of held torques.

    The outputs of lagging motors are part of the state, after (x, Ωη, ẋ, η̇).
    """
    A, _ = first_order(linear.plant)
    forces, _ = acting(linear)
    force = np.vstack([np.zeros_like(forces), np.linalg.solve(linear.plant.mass, forces)])
    scale = beam_scale(linear)
    A, force = A * scale[:, None] / scale, force * scale[:, None]
    A, force = with_lag(A, force, linear.probe.original.joints.motor.time_constant)
    if period is None:
        return A, force
    return hold(A, force, period)


def with_lag(A: np.ndarray, B: np.ndarray, time_constant: float) -> tuple[np.ndarray, np.ndarray]:
    """A and B with inputs that lag by a time constant, s; the lagging inputs are states after the others."""
    if time_constant == 0:
        return A, B
    count = B.shape[1]
    late = np.eye(count) / time_constant
    return np.block([[A, B], [np.zeros((count, len(A))), -late]]), np.vstack([np.zeros_like(B), late])


def by_state(linear: Linearization, by_motion: np.ndarray) -> np.ndarray:
    """Convert derivatives by (x, η, ẋ, η̇), (rows, 2 n), to those by the state of `held_plant`; motor forces are not measured."""
    scaled = by_motion / beam_scale(linear)
    return np.hstack([scaled, np.zeros((len(scaled), late_count(linear)))])


def late_count(linear: Linearization) -> int:
    """Number of states of lagging motors."""
    return len(acting(linear)[1]) * (linear.probe.original.joints.motor.time_constant > 0)


def kept_memory(linear: Linearization) -> np.ndarray:
    """Indices of memory states that change to first order, without those that never rest.

    b̂, for example, is left out with its neutral poles: at rest s = 0, ‖s‖ has no slope, and b̂ is constant.
    """
    torques = linear.torque_count
    rows = np.hstack([linear.law.motion, linear.law.memory])[torques:]
    return np.flatnonzero(np.any(rows != 0, axis=1) & ~linear.rest.moving)


def close_loop(
    A: np.ndarray, B: np.ndarray, asked: np.ndarray, memory: np.ndarray, line: int, late: int
) -> tuple[np.ndarray, np.ndarray]:
    """The loop of a plant A, B and a law, and the torques in force; columns: all states, then any inputs.

    States: the plant's, the law's memory, and a `line` of torques, the last `late` of which are on their way. `asked`: the
    torques that the law asks for; `memory`: its memory's rate, or its memory one control period later.
    """
    own, width = len(A) + len(memory), asked.shape[1]
    held = np.eye(len(asked), width, own + line - late) if late else asked
    plant = B @ held
    plant[:, : len(A)] += A
    moved_on = [np.eye(line - len(asked), width, own + len(asked)), asked] if line else []
    return np.vstack([plant, memory, *moved_on]), held


def loop_map(linear: Linearization) -> np.ndarray:
    """The matrix of the closed loop of plant and law: of dz/dt (1/s), or of z one control period later.

    z: the state of `held_plant`, kept memory, torques held until now (if the law uses them) and on their way.
    """
    law, torques, kept = linear.law, linear.torque_count, kept_memory(linear)
    controller = linear.probe.original.controller
    A, B = held_plant(linear, controller.control_period)
    _, effect = acting(linear)
    # Torques, too, enter by their effect; for a law that uses torques, those held until now are states.
    late = len(effect) * controller.input_delay
    line = np.zeros((0, late))
    if law.line.shape[1]:
        line = np.kron(np.eye(controller.input_delay + 1), np.linalg.pinv(effect))
    answer = np.hstack([by_state(linear, law.motion), law.memory[:, kept], law.line @ line])
    asked, memory = effect @ answer[:torques], answer[torques + kept]
    if controller.control_period is not None:
        memory[:, len(A) : len(A) + len(kept)] += np.eye(len(kept))
    return close_loop(A, B, asked, memory, line.shape[1], late)[0]


def find_poles(linear: Linearization) -> Poles:
    """The poles of the loop, without those of torques that vanish within a control period."""
    value, left, right = eigenvectors(loop_map(linear))
    # Participation |l_i r_i| of each state in each eigenvalue (rows), independent of the states' units; rows add up to 1.
    product = np.abs(left.conj() * right).T
    share = product / np.maximum(product.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    groups = np.zeros((len(value), linear.probe.mode_count + 3))
    n = linear.probe.mode_count
    late = 6 + 2 * n + late_count(linear)
    own = late + len(kept_memory(linear))
    groups[:, 0] = share[:, :3].sum(axis=1) + share[:, 3 + n : 6 + n].sum(axis=1)
    groups[:, 1 : 1 + n] = share[:, 3 : 3 + n] + share[:, 6 + n : 6 + 2 * n]
    groups[:, 1 + n] = share[:, late:own].sum(axis=1)
    groups[:, 2 + n] = share[:, 6 + 2 * n : late].sum(axis=1) + share[:, own:].sum(axis=1)
    if (period := linear.probe.original.controller.control_period) is not None:
        there = np.abs(value) > DEADBEAT
        value, groups = np.log(value[there].astype(complex)) / period, groups[there]
    value = np.where(np.abs(value.imag) < ALIKE * np.abs(value), value.real, value)
    value = np.where(np.abs(value.real) < AT_REST, 1j * value.imag, value)
    value[np.abs(value) < AT_REST] = 0
    order = np.argsort(np.abs(value), kind="stable")
    return Poles(value[order], groups[order])


GRID = 300
"""Number of frequencies of the search for the worst case, besides those around the poles."""
SLOWER, DIGITS = 30, 2e-7
"""Ratio of the slowest pole to the slowest of these frequencies, and least ratio to the fastest for a slower one: rounding errors
of margins grow with the inverse square, and are 1e-5 there."""
AROUND = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0])
"""Further frequencies around a pole's, in units of its half-width |Re|."""
FINER, BETWEEN = 2, 17
"""Rounds of the search around the worst of these frequencies, and number of frequencies in each."""
SCALINGS = 12
"""Rounds of balancing the scaled matrix, each of which at least halves the imbalance."""
LARGEST = 2.0
"""α of a loop that is stable under any gain and phase."""


class Margin(NamedTuple):
    """The deviation up to which the loop is stable."""

    alpha: float
    """α, from 0 (unstable) to 2 (stable under any deviation)."""
    frequency: float
    """Frequency of the worst case, Hz; NaN of an unstable loop."""

    @property
    def gain(self) -> tuple[float, float]:
        """Least and largest factor on the gains."""
        if self.alpha >= LARGEST:
            return 0.0, np.inf
        return (2 - self.alpha) / (2 + self.alpha), (2 + self.alpha) / (2 - self.alpha)

    @property
    def phase(self) -> float:
        """Largest phase by which torques may lead or lag, °."""
        return float(np.degrees(2 * np.arctan(self.alpha / 2)))


class DiskMargin(NamedTuple):
    """Margins of the loop broken at its joint torques."""

    alike: Margin
    """Margin if all motors deviate by one factor, as by another gain or delay."""
    each: Margin
    """Margin if each motor deviates by a factor of its own, in the worst combination."""


def find_disk_margin(linear: Linearization, poles: np.ndarray) -> DiskMargin:
    """The disk margins of a loop with these poles (1/s)."""
    if np.any(poles.real > NEUTRAL):
        lost = Margin(0.0, np.nan)
        return DiskMargin(lost, lost)
    rates = _rates(linear, poles)
    size = _deviations(linear, rates)
    for _ in range(FINER):
        rates = np.unique(np.concatenate([_around(rates, int(worst)) for worst in size.argmax(axis=1)]))
        size = _deviations(linear, rates)
    return DiskMargin(*(_margin(row, rates) for row in size))


def _deviations(linear: Linearization, rates: np.ndarray) -> np.ndarray:
    """μ((S - T)/2) if all motors have one factor, and its upper bound if each has its own, (2, rates)."""
    loop = _torque_loop(linear, rates)
    identity = np.eye(linear.torque_count)
    # With H from torques in force to torques asked for, L = -H: S = (1 - H)⁻¹ and S - T = S (1 + H).
    deviation = np.linalg.solve(identity - loop, identity + loop) / 2
    return np.stack([np.abs(np.linalg.eigvals(deviation)).max(axis=1), _structured_norm(deviation)])


def _around(rates: np.ndarray, place: int) -> np.ndarray:
    """Angular frequencies from the one before a place to the one after it, 1/s."""
    low, high = rates[max(place - 1, 0)], rates[min(place + 1, len(rates) - 1)]
    return np.append(np.linspace(low, high, BETWEEN), rates[place])


def _margin(size: np.ndarray, rates: np.ndarray) -> Margin:
    worst = int(np.argmax(size))
    return Margin(float(min(LARGEST, 1 / size[worst])), float(rates[worst] / (2 * np.pi)))


def _rates(linear: Linearization, poles: np.ndarray) -> np.ndarray:
    """Angular frequencies that find every peak, 1/s."""
    period = linear.probe.original.controller.control_period
    size = np.abs(poles)
    size = size[size > NEUTRAL]
    low, high = (1.0, 1e3) if len(size) == 0 else (size.min() / SLOWER, 10 * size.max())
    # Further below the poles, a margin is that at rest, as far as the plant's integrators leave digits.
    low = min(low, max(low / 10, DIGITS * high))
    if period is not None:
        high = np.pi / period
    swinging = poles[(poles.imag > 0) & (np.abs(poles) > NEUTRAL)]
    near = (swinging.imag[:, None] + np.abs(swinging.real)[:, None] * AROUND).ravel()
    grid = np.geomspace(min(low, high / 10), high, GRID)
    return np.unique(np.concatenate([grid, near[(near > grid[0]) & (near < high)]]))


def _torque_loop(linear: Linearization, rates: np.ndarray) -> np.ndarray:
    """H(ω), from joint torques in force to those that the law asks for, (rates, arms · 3, arms · 3)."""
    controller, law, torques = linear.probe.original.controller, linear.law, linear.torque_count
    period, kept = controller.control_period, kept_memory(linear)
    (A, B), (_, effect) = held_plant(linear, period), acting(linear)
    triangle, basis = complex_schur(A)
    force = basis.conj().T @ B
    answer = by_state(linear, law.motion[:torques]) @ basis
    memory_in = by_state(linear, law.motion[torques + kept]) @ basis
    memory_out, memory_own = law.memory[:torques, kept], law.memory[np.ix_(torques + kept, kept)]
    seen = law.line.reshape(len(law.line), -1, torques)
    where = 1j * rates if period is None else np.exp(1j * rates * period)
    # In the order in which LAPACK leaves each solution.
    motion = np.empty((len(rates), force.shape[1], len(A)), dtype=complex).transpose(0, 2, 1)
    shifted, diagonal = -triangle, np.diag_indices_from(triangle)
    own = triangle[diagonal]
    rounding = np.finfo(float).eps * np.abs(own).max()
    for k, z in enumerate(where):
        # A pole that the law does not move may be met exactly.
        shifted[diagonal] = np.where(z == own, rounding, z - own)
        motion[k] = solve_triangular(shifted, force, check_finite=False)
    # The law knows which torques it asked for; the torques in force deviate from these.
    ago = np.zeros((len(rates), len(seen), torques), dtype=complex)
    if seen.shape[1]:
        ago[:] = [np.tensordot(seen, z ** np.arange(-seen.shape[1], 0), (1, 0)) for z in where]
    asked, known = answer @ motion, ago[:, :torques]
    if len(kept):
        slope = (where if period is None else where - 1)[:, None, None]
        told = np.concatenate([memory_in @ motion, ago[:, torques + kept]], axis=2)
        through = memory_out @ np.linalg.solve(slope * np.eye(len(kept)) - memory_own, told)
        asked, known = asked + through[:, :, : len(effect)], known + through[:, :, len(effect) :]
    if seen.shape[1]:
        asked = np.linalg.solve(np.eye(torques) - known, asked)
    if period is not None:
        asked = np.reshape([z**-controller.input_delay for z in where], (-1, 1, 1)) * asked
    return asked @ effect


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
