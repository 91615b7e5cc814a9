"""Where a closed loop comes to rest: Newton's method on the engine's own forces."""

from typing import NamedTuple

import numpy as np

from flexlab.analysis.loop_probe import LoopProbe, Motion
from flexlab.errors import StudyError

MOST_STEPS = 14
"""Newton steps: a rest point that exists is found in half of them; what needs more drifts away from where it began."""
LONGEST_STEP = 0.1
"""Longest change of the pose in one Newton step, m and rad: arms bend their elbows within a few times that."""
BALANCED = 1e-9
"""Force left over, and law's memory that still moves, relative to what holds the arms, below which the loop rests."""
MOST_ROUNDS = 30
"""Rounds in which a law and the torques in force come to agree: an observer's part of its answer is under a tenth."""
DIFFERENCE = 1e-6
"""Step of the central differences, m, rad and units of the memory."""


class RestPoint(NamedTuple):
    """A closed loop at rest."""

    motion: Motion
    torque: np.ndarray
    """Joint torques that hold it, N·m, (arms · 3,)."""
    memory: np.ndarray
    """The law's memory there, (memory,)."""
    desired: np.ndarray
    """x_d, ẋ_d, ẍ_d, (3, 3): the pose asked for, held."""
    moving: np.ndarray
    """Which memory states still move, (memory,): the rest point is that of the law with those as at their start."""

    @property
    def drifting(self) -> bool:
        """Whether part of the memory never rests."""
        return bool(np.any(self.moving))


def find_rest(probe: LoopProbe, target: np.ndarray) -> RestPoint:
    """The rest point of the loop whose desired pose (3,) is held; raises `StudyError` if there is none.

    First with the law's memory as at its start. If it moves there (an integral part fills, an observer estimates), its
    rest value is sought too; if there is none, as for estimates that only grow, those that grow are held at their start.
    """
    desired = np.zeros((3, 3))
    desired[0] = target
    start, count = np.concatenate([target, probe.start_memory]), len(probe.start_memory)

    def balance(z: np.ndarray) -> np.ndarray:
        return _unbalance(probe, z, desired)

    balance(start)  # A law that fails is told by its own sentence.
    frozen = _newton(balance, start, np.arange(3))
    if frozen is not None and _rests(balance(frozen)):
        return _rest_point(probe, frozen, desired, np.arange(0))
    begin = start if frozen is None else frozen
    settling = np.setdiff1d(np.arange(3 + count), 3 + probe.growing)
    for free in (np.arange(3 + count), settling):
        found = _newton(balance, begin, free) if len(free) > 3 else None
        if found is not None:
            return _rest_point(probe, found, desired, np.setdiff1d(np.arange(3 + count), free))
    if frozen is None:
        raise StudyError(_no_rest(target))
    return _rest_point(probe, frozen, desired, np.arange(3, 3 + count))


def _no_rest(target: np.ndarray) -> str:
    pose = f"x = {target[0]:.3f} m, y = {target[1]:.3f} m, θ = {target[2]:.3f} rad"
    return (
        f"The loop has no rest point near {pose}: the motors do not hold the weight there. "
        "Choose a law that holds the arms, higher gains, or no gravity."
    )


def _unbalance(probe: LoopProbe, z: np.ndarray, desired: np.ndarray) -> np.ndarray:
    """Force on the pose (3,), and change of the memory, both relative to what holds the arms; z: pose and memory."""
    motion, torque = _hold(probe, z[:3], z[3:], desired)
    change = probe.answer(motion, z[3:], desired, torque)[1]
    size = 1 + np.abs(probe.forces(motion, 0 * torque)[:3]).max()
    return np.concatenate([probe.forces(motion, torque)[:3] / size, change])


def _hold(probe: LoopProbe, pose: np.ndarray, memory: np.ndarray, desired: np.ndarray) -> tuple[Motion, np.ndarray]:
    """The beam bent by its own weight at a pose, and the torques that the law answers there."""
    straight = probe.at_rest(pose)
    weight = probe.forces(straight, np.zeros(3 * probe.arm_count))[3:]
    motion = straight._replace(eta=weight / probe.beam.modes.omega**2)
    torque = np.zeros(3 * probe.arm_count)
    # A law that looks at the torques in force answers them, and they press the beam: its rest is where all agree.
    for _ in range(MOST_ROUNDS):
        before, torque = torque, probe.answer(motion, memory, desired, torque)[0]
        if probe.feels_axial_load:
            stiffness = np.diag(probe.beam.modes.omega**2) + probe.axial_stiffness(motion, torque)
            motion = straight._replace(eta=np.linalg.solve(stiffness, weight))
        if np.abs(torque - before).max() <= BALANCED * BALANCED * (1 + np.abs(torque).max()):
            break
    return motion, torque


def _rests(unbalance: np.ndarray) -> bool:
    return bool(np.abs(unbalance).max() < BALANCED)


def _rest_point(probe: LoopProbe, z: np.ndarray, desired: np.ndarray, held: np.ndarray) -> RestPoint:
    motion, torque = _hold(probe, z[:3], z[3:], desired)
    moving = np.isin(np.arange(3, len(z)), held)
    return RestPoint(motion, torque, z[3:].copy(), desired, moving)


def _newton(balance, start: np.ndarray, free: np.ndarray) -> np.ndarray | None:
    """The zero of the first len(free) equations over the unknowns `free`, or None. Redundant unknowns change least."""
    z = start.copy()
    for _ in range(MOST_STEPS):
        try:
            left = balance(z)[free]
            if _rests(left):
                return z
            slope = np.empty((len(free), len(free)))
            for column, unknown in enumerate(free):
                up, down = z.copy(), z.copy()
                up[unknown] += DIFFERENCE
                down[unknown] -= DIFFERENCE
                slope[:, column] = (balance(up)[free] - balance(down)[free]) / (2 * DIFFERENCE)
        except StudyError:
            return None
        change = -np.linalg.lstsq(slope, left, rcond=1e-12)[0]
        if not np.all(np.isfinite(change)):
            return None
        z[free] += change / max(1.0, np.abs(change[:3]).max() / LONGEST_STEP)
    return None
