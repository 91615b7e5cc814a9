"""A scenario's loop, linearised about its rest point: M p̈ + C ṗ + K p = B τ for the plant, and the law's answer to it.

Coordinates p = (x, η): pose (m, m, rad) and modal coordinates (m·kg^½). At rest all velocity terms are of second order, so
that mass, damping and stiffness describe the plant exactly. Motors hold the joint torques τ, and u = 𝒥ᵀτ turns with the pose,
which contributes to K.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from flexlab.analysis.rest_point import LoopProbe, RestPoint
from flexlab.physics.plant import has_axial_load


def central(function: Callable[[np.ndarray], np.ndarray], direction: np.ndarray, size: float) -> np.ndarray:
    """(f(+step) - f(-step)) / 2 size for step = size · direction: order 2."""
    step = size * direction
    return (function(step) - function(-step)) / (2 * size)


def fourth_order(function: Callable[[np.ndarray], np.ndarray], direction: np.ndarray, size: float) -> np.ndarray:
    """Richardson's combination of steps of `size` and 2 `size`: order 4."""
    return richardson(central(function, direction, size), function, direction, size)


def richardson(
    slope: np.ndarray, function: Callable[[np.ndarray], np.ndarray], direction: np.ndarray, size: float
) -> np.ndarray:
    """The derivative of order 4 from that of order 2, `central(function, direction, size)`."""
    return (4 * slope - central(function, direction, 2 * size)) / 3


POSE_STEP = 1e-4
"""Step of fourth-order differences in pose and pose rate (m, rad, m/s, rad/s); their relative error is 1e-12."""
KINK = 0.1
"""Ratio of slope to the change common to both sides, below which a memory's rate counts as a kink at rest without a slope."""
LAYER_SHARE = 1e-2
"""Largest step as a share of a boundary layer, within which a sliding-mode law is smooth."""


class Plant(NamedTuple):
    """Arms and beam under held joint torques; n = 3 + n_m coordinates."""

    mass: np.ndarray
    """M, (n, n), symmetric."""
    damping: np.ndarray
    """C, (n, n)."""
    stiffness: np.ndarray
    """K, (n, n), symmetric."""
    input: np.ndarray
    """B = [Σ𝒥ᵀ; 0], joint torques to generalised forces, (n, arms · 3)."""


class Law(NamedTuple):
    """Derivatives of the law's answer at rest; rows: joint torques (arms · 3), then the memory's change."""

    motion: np.ndarray
    """With respect to (x, η, ẋ, η̇), (rows, 2 n)."""
    memory: np.ndarray
    """With respect to the law's memory, (rows, memory)."""
    desired: np.ndarray
    """With respect to (x_d, ẋ_d, ẍ_d), (rows, 9)."""
    line: np.ndarray
    """With respect to the torques held until now and on their way, (rows, (delay + 1) · arms · 3); (rows, 0) for a law without
    this input."""


class Linearization(NamedTuple):
    """Plant and law about a rest point."""

    probe: LoopProbe
    rest: RestPoint
    plant: Plant
    law: Law

    @property
    def torque_count(self) -> int:
        """Number of motors, arms · 3."""
        return self.plant.input.shape[1]

    @property
    def omega(self) -> np.ndarray:
        """Frequencies of the beam with its grips held, rad/s, (n_m,)."""
        return self.probe.beam.modes.omega


def linearize_loop(probe: LoopProbe, rest: RestPoint) -> Linearization:
    """Linearise plant and law about a rest point."""
    law = _law(probe, rest)
    if probe.original.joints.encoders.active:
        law, rest = _differencing(law, probe.original.controller.control_period, rest)
    return Linearization(probe, rest, _plant(probe, rest), law)


def _differencing(law: Law, period: float, rest: RestPoint) -> tuple[Law, RestPoint]:
    """The law with the pose rate taken as a difference over the control period, s; the last pose joins its memory.

    The encoders' rounding is left out.
    """
    n, torques, count = law.motion.shape[1] // 2, len(rest.torque), len(rest.memory)
    by_rate = law.motion[:, n : n + 3] / period
    motion, keeps = law.motion.copy(), np.eye(3, 2 * n)
    motion[:, :3] += by_rate
    motion[:, n : n + 3] = 0.0
    memory = np.zeros((torques + count + 3, count + 3))
    memory[:-3, :count], memory[:-3, count:], memory[-3:, count:] = law.memory, -by_rate, -np.eye(3)
    desired, line = (np.vstack([part, np.zeros((3, part.shape[1]))]) for part in (law.desired, law.line))
    remembered = np.concatenate([rest.memory, rest.motion.x]), np.concatenate([rest.moving, np.zeros(3, bool)])
    law = Law(np.vstack([motion, keeps]), memory, desired, line)
    return law, rest._replace(memory=remembered[0], moving=remembered[1])


def first_order(plant: Plant) -> tuple[np.ndarray, np.ndarray]:
    """A (2n, 2n) and B (2n, arms · 3) of the state (x, η, ẋ, η̇)."""
    n = len(plant.mass)
    accelerations = np.linalg.solve(plant.mass, np.hstack([-plant.stiffness, -plant.damping, plant.input]))
    A = np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), accelerations[:, : 2 * n]])
    return A, np.vstack([np.zeros_like(plant.input), accelerations[:, 2 * n :]])


def _plant(probe: LoopProbe, rest: RestPoint) -> Plant:
    n = 3 + probe.mode_count
    still, idle = probe.momenta(rest.motion), np.zeros_like(rest.torque)

    def force(step: np.ndarray) -> np.ndarray:
        return probe.forces(rest.motion.moved(step), rest.torque)

    unit = np.eye(2 * n)
    mass = np.stack([probe.momenta(rest.motion.moved(unit[n + k])) - still for k in range(n)], axis=1)
    # Forces are linear in the beam's coordinates and in all rates at rest: a unit step has no truncation error.
    stiffness = [-fourth_order(force, unit[k], POSE_STEP) for k in range(3)]
    # The force along the beam, however, multiplies the beam's coordinates.
    size = POSE_STEP if has_axial_load(probe.system.plant.axial) else 1.0
    stiffness += [-central(force, unit[k], size) for k in range(3, n)]
    damping = [-central(force, unit[n + k], size) for k in range(n)]
    if np.isfinite(probe.rate_step):
        damping[:3] = [-fourth_order(force, unit[n + k], probe.rate_step) for k in range(3)]
    free = probe.forces(rest.motion, idle)
    torques = [probe.forces(rest.motion, torque) - free for torque in np.eye(len(rest.torque))]
    return Plant(mass, np.stack(damping, axis=1), np.stack(stiffness, axis=1), np.stack(torques, axis=1))


def _law(probe: LoopProbe, rest: RestPoint) -> Law:
    n, count = 3 + probe.mode_count, len(rest.memory)
    size = POSE_STEP
    settings = getattr(probe.scenario.controller, "slow", probe.scenario.controller)
    layer = getattr(settings, "boundary_layer", None)
    if layer is not None:
        slope = float(np.max(getattr(settings, "sliding_slope", 1.0)))
        size = min(size, LAYER_SHARE * layer / (1 + slope))
    size = min(size, probe.rate_step)
    torques = len(rest.torque) * _seen_torques(probe, rest)
    parts = np.cumsum([2 * n, count, 9])

    def answer(step: np.ndarray) -> np.ndarray:
        motion, memory, desired, line = (
            step[begin:end] for begin, end in zip((0, *parts), (*parts, None), strict=True)
        )
        asked = rest.desired + desired.reshape(3, 3)
        shown = rest.torque + line.reshape(-1, len(rest.torque)) if torques else rest.torque
        moved = rest.motion.moved(motion) if motion.any() else rest.motion
        return np.concatenate(probe.answer(moved, rest.memory + memory, asked, shown))

    directions = np.eye(parts[-1] + torques)
    # The change of a memory is the difference of two values that are rounded.
    rounding = np.concatenate([np.zeros(len(rest.torque)), np.finfo(float).eps * (1 + np.abs(rest.memory))])
    slopes, at_rest = [], answer(np.zeros(len(directions)))
    for k, direction in enumerate(directions):
        of_beam, of_memory = k < 2 * n and k % n >= 3, 2 * n <= k < parts[1] or k >= parts[2]
        step = 1.0 if of_memory else size
        ahead, behind = answer(step * direction), answer(-step * direction)
        slope = (ahead - behind) / (2 * step)
        if not (of_beam or of_memory):
            slope = richardson(slope, answer, direction, step)
        kink = (ahead + behind - 2 * at_rest) / (2 * step)
        # A memory driven by a norm, as b̂ is by ‖s‖, changes alike on both sides: it has a kink and no slope.
        flat = np.abs(slope) < np.maximum(KINK * np.abs(kink), rounding / step)
        flat[: len(rest.torque)] = False
        slopes.append(np.where(flat, 0.0, slope))
    return Law(*np.split(np.stack(slopes, axis=1), parts, axis=1))


def _seen_torques(probe: LoopProbe, rest: RestPoint) -> int:
    """The number of instants whose torques the law uses: none or all."""
    shown = np.tile(rest.torque, (probe.line_length, 1))
    other = shown + np.arange(1, 1 + shown.size).reshape(shown.shape)
    answers = [np.concatenate(probe.answer(rest.motion, rest.memory, rest.desired, line)) for line in (shown, other)]
    return probe.line_length if np.any(answers[0] != answers[1]) else 0
