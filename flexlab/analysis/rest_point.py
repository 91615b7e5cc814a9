"""The rest point of a closed loop, found by Newton's method on the engine's forces, and the engine as plain functions.

Every linearisation differentiates these functions.
"""

from typing import NamedTuple

import numpy as np

from flexlab.control.law import BOUND_ESTIMATES, law_of
from flexlab.control.observers.observer import ESTIMATE
from flexlab.control.path import build_motion, paths
from flexlab.control.paths.sine import SineTrajectory
from flexlab.errors import ScenarioError, StudyError
from flexlab.physics.dynamics import set_momenta
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import AXIAL, ETA, P, X, forget_rates
from flexlab.scenario import Scenario
from flexlab.scenario.settings import IDEAL, PERIOD
from flexlab.sim.assembly import build_strains, build_system
from flexlab.sim.build import build_beam
from flexlab.sim.closed_loop import System, memory_slice, new_workspace, rates_at, state_length
from flexlab.sim.motion import law_start, start_controller
from flexlab.sim.sampled_control import Sampling, control_instant, with_kernel

PROBE_PERIOD = 1e-3
"""Control period for a scenario without one, s; the law's answer at an instant does not depend on it."""
STRAIGHT = 1e-3
"""Largest step of the pose rate, as a share of the friction's smoothing speed, within which friction is nearly linear."""


class Motion(NamedTuple):
    """Position and rates of the plant with n_m modes."""

    x: np.ndarray
    """Pose, (3,)."""
    eta: np.ndarray
    """Modal coordinates, m·kg^½, (n_m,)."""
    v: np.ndarray
    """Pose rate, (3,)."""
    eta_dot: np.ndarray
    """(n_m,)."""

    def moved(self, step: np.ndarray) -> "Motion":
        """The motion displaced by `step` (2 (3 + n_m),), in the order of the fields."""
        n = len(self.eta)
        x, eta, v, eta_dot = step[:3], step[3 : 3 + n], step[3 + n : 6 + n], step[6 + n :]
        return Motion(self.x + x, self.eta + eta, self.v + v, self.eta_dot + eta_dot)


def aim(system: System, desired: np.ndarray) -> None:
    """Set value, rate and acceleration of the path at t = 0 to `desired` (3, 3); a sine of 1 rad/s can take any."""
    path, (x, v, a) = system.trajectory.numbers.view(paths()["sine"].record)[0], desired
    path["center"], path["amplitude"], path["phase"] = x + a, np.hypot(v, a), np.arctan2(-a, v)
    path["frequency"] = 1 / (2 * np.pi)


class LoopProbe:
    """Plant and law of a scenario at any motion. Raises `StudyError` for a pose that an arm cannot take."""

    def __init__(self, scenario: Scenario):
        """`scenario`: a valid one, whose noise, limits, delay, motors, encoders, grips and path are left out."""
        self.original = scenario
        period = scenario.controller.control_period
        try:
            scenario = scenario.replace({PERIOD: period or PROBE_PERIOD, **IDEAL})
        except ScenarioError as error:
            raise StudyError(str(error)) from None
        self.scenario = scenario
        self.beam = build_beam(scenario.payload)
        # `aim` needs a sine.
        aimed = build_motion(SineTrajectory())._replace(bending=scenario.trajectory.bending_feedforward)
        system = build_system(scenario, self.beam)
        # The law derives its gains from the scenario's own noise and delay.
        control = system.control
        if scenario != self.original:
            control = control._replace(gains=law_of(self.original.controller).gains(self.original))
        self.system = system._replace(trajectory=aimed, control=control)
        self.arm_count, self.mode_count = len(scenario.arms), len(self.beam.modes.omega)
        self.size = 2 * (3 + self.mode_count)
        """Number of components of a displacement."""
        # Over a period of 1 s the change of a continuous law's memory is its rate.
        delay = self.original.controller.input_delay
        sampling = Sampling(
            period=period or 1.0, steps=1, delay=delay, noise=np.zeros(8), gauge_noise=np.zeros((2, 0)),
            strain=build_strains(scenario, self.beam), strain_noise=0.0, seed=0, line=np.zeros((delay + 1, self.arm_count, 3)),
        )  # fmt: skip
        # `control_instant` is found on disk if it is asked for as in a sampled run.
        self._sampling = with_kernel(sampling, self.system)
        self._workspace = new_workspace(self.system)
        self._y = np.zeros(state_length(self.system))
        self._placed: Motion | None = None
        self._memory = memory_slice(self.system)
        slices = law_of(scenario.controller).memory_slices(self.arm_count)
        growing = slices.get(BOUND_ESTIMATES.name, slice(0))
        self.growing = np.arange(len(self._y[self._memory]))[growing]
        """Indices of memory states that only grow, and rest only if nothing drives them."""
        self.observed = np.arange(len(self._y[self._memory]))[slices.get(ESTIMATE, slice(0))]
        """Indices of an observer's states, which have one rest value each."""
        y = self._y.copy()
        y[X : X + 3] = self.original.trajectory.middle
        begin = law_start(scenario, self.system, 0.0, y, self._workspace, True)
        start_controller(scenario, self.system, begin, y)
        self.start_memory = y[self._memory].copy()
        """The law's memory at the start of a run, (memory,)."""

    def at_rest(self, pose: np.ndarray) -> Motion:
        """The plant at rest at a pose with a straight beam."""
        nothing = np.zeros(self.mode_count)
        return Motion(np.array(pose, dtype=float), nothing, np.zeros(3), nothing.copy())

    def state(self, motion: Motion, memory: np.ndarray) -> np.ndarray:
        """The engine's state y of a motion."""
        self._set(motion)
        y = self._y.copy()
        y[self._memory] = memory[: len(y[self._memory])]
        forget_rates(y, self.mode_count)
        return y

    def momenta(self, motion: Motion) -> np.ndarray:
        """(P, π) of a motion, (3 + n_m,)."""
        self._set(motion)
        n = self.mode_count
        return np.concatenate([self._y[P : P + 3], self._y[ETA + n : ETA + 2 * n]])

    def forces(self, motion: Motion, torque: np.ndarray) -> np.ndarray:
        """(Ṗ, π̇) under held joint torques (arms · 3,), N·m; (3 + n_m,)."""
        self._set(motion)
        self.system.held_torque[:] = torque.reshape(-1, 3)
        dy, n = np.zeros_like(self._y), self.mode_count
        self._check(rates_at(self.system, 0.0, self._y, self._workspace, dy, True))
        return np.concatenate([dy[P : P + 3], dy[ETA + n : ETA + 2 * n]])

    @property
    def rate_step(self) -> float:
        """Largest step of the pose rate, m/s, rad/s, within which the joints' friction is linear."""
        friction = self.scenario.joints.friction
        return STRAIGHT * friction.smoothing_speed if friction.active else np.inf

    def axial_stiffness(self, motion: Motion, torque: np.ndarray) -> np.ndarray:
        """K_G of a motion under held joint torques (arms · 3,), N·m, in modes, (n_m, n_m)."""
        self.forces(motion, torque)
        whole = np.zeros((self.mode_count, self.mode_count))
        if self.system.plant.axial is None:
            return whole
        left, along, spin, _ = self._workspace.axial
        G0, G1, G2, _ = self.system.plant.axial
        feels = np.flatnonzero(self.system.plant.modal[AXIAL])
        whole[np.ix_(feels, feels)] = left * G0 + along * G1 + spin * G2
        return whole

    @property
    def line_length(self) -> int:
        """Number of instants whose torques a sampled law sees: those held until now and those on their way."""
        return len(self._sampling.line)

    def answer(
        self, motion: Motion, memory: np.ndarray, desired: np.ndarray, line: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Joint torques (arms · 3,) that the law computes at an instant, and the change of its memory, (memory,).

        `desired`: x_d, ẋ_d, ẍ_d (3, 3). `line`: torques held until now and those on their way, N·m, (line, arms · 3), or
        the same for all, (arms · 3,). The change is per control period, or per second for a continuous law. Raises
        `StudyError` if the law fails.
        """
        self._sampling.line[:] = line.reshape(-1, self.arm_count, 3)
        aim(self.system, desired)
        self._set(motion)
        own = self._y[self._memory]
        own[:] = memory
        self._check(control_instant(self.system, self._sampling, 0, 0.0, self._y, self._workspace))
        torque, change = self._sampling.line[-1].ravel().copy(), own - memory
        if not (np.isfinite(torque).all() and np.isfinite(change).all()):
            settings = self.original.controller
            said = law_of(settings).problem(settings) or "its torques or its memory are not finite numbers."
            raise StudyError(f"The control law {settings.kind} fails where the payload is to rest: {said}")
        return torque, change

    def task_inputs(self, motion: Motion) -> np.ndarray:
        """𝒥ᵀ of all arms, which maps joint torques (arms · 3,) to the arms' inputs u_i (arms · 3,)."""
        columns = []
        for torque in np.eye(3 * self.arm_count):
            self.forces(motion, torque)
            columns.append(self._workspace.u.ravel().copy())
        return np.stack(columns, axis=1)

    def _set(self, motion: Motion) -> None:
        if motion is self._placed:  # Most answers and forces are asked for at the motion before.
            return
        self._placed, n = None, self.mode_count
        self._y[X : X + 3], self._y[ETA : ETA + n] = motion.x, motion.eta
        find_mass_at(self.system.plant, 0.0, self._workspace)
        self._check(set_momenta(self.system.plant, self._y, motion.v, motion.eta_dot, self._workspace))
        self._placed = motion

    def _check(self, code: int) -> None:
        if code != 0:
            pose = ", ".join(f"{value:.4g}" for value in self._y[X : X + 3])
            raise StudyError(
                f"An arm cannot take the pose ({pose}) m, m, rad: choose one farther inside its workspace."
            )


MOST_STEPS = 14
"""Largest number of Newton steps: half of them find an existing rest point, and more only drift away."""
LONGEST_STEP = 0.1
"""Largest change of the pose in one Newton step, m and rad; elbows flip within a few of these."""
BALANCED = 1e-9
"""Residual force, relative to the forces that hold the arms, and residual change of the memory, below which the loop rests."""
BEND = 1e-3
"""Scale of the residual bend of the beam, as a modal coordinate, m·kg^½."""
DIFFERENCE = 1e-6
"""Step of the central differences, m, rad, m·kg^½, N·m and units of the memory."""


class RestPoint(NamedTuple):
    """A closed loop at rest."""

    motion: Motion
    torque: np.ndarray
    """Joint torques that hold it, N·m, (arms · 3,)."""
    memory: np.ndarray
    """The law's memory there, (memory,)."""
    desired: np.ndarray
    """x_d, ẋ_d, ẍ_d, (3, 3): the desired pose, at rest."""
    moving: np.ndarray
    """Which memory states never rest, (memory,); the rest point holds for their values at the start."""

    @property
    def drifting(self) -> bool:
        """Whether a part of the memory never rests."""
        return bool(np.any(self.moving))


def find_rest(probe: LoopProbe, target: np.ndarray) -> RestPoint:
    """The rest point of the loop under a constant desired pose (3,). Raises `StudyError` if there is none.

    The law's memory first keeps its start value. If it moves there, as an integral part or an observer does, its rest value
    is sought too, for as few states as possible, since estimates that nothing moves can have any value. If there is no such
    point, states that only grow keep their start value.
    """
    desired = np.zeros((3, 3))
    desired[0] = target
    no_torque, count = np.zeros(3 * probe.arm_count), len(probe.start_memory)
    ends = np.cumsum([3, count, probe.mode_count])
    stiffness = probe.beam.modes.omega**2
    weight = probe.forces(probe.at_rest(target), no_torque)[3:]
    motion = probe.at_rest(target)._replace(eta=weight / stiffness)
    torque = probe.answer(motion, probe.start_memory, desired, no_torque)[0]
    start = np.concatenate([target, probe.start_memory, motion.eta, torque])

    def parts(z: np.ndarray) -> tuple[Motion, np.ndarray, np.ndarray]:
        """Motion, torque and memory of the unknowns z: pose, memory, bend and joint torques."""
        pose, memory, eta, torque = z[: ends[0]], z[ends[0] : ends[1]], z[ends[1] : ends[2]], z[ends[2] :]
        return probe.at_rest(pose)._replace(eta=eta), torque, memory

    def balance(z: np.ndarray) -> np.ndarray:
        """Residuals: forces on the pose, the memory's change, forces on the bend, and torques asked for minus those in force.

        They are coupled: a law may use the torques in force, these load the beam, and its bend changes the force along it.
        """
        motion, torque, memory = parts(z)
        force = probe.forces(motion, torque)
        size = 1 + np.abs(probe.forces(motion, no_torque)[:3]).max()  # The forces that hold the arms.
        asked, change = probe.answer(motion, memory, desired, torque)
        return np.concatenate([force[:3] / size, change, force[3:] / (stiffness * BEND), (asked - torque) / size])

    def rest_point(z: np.ndarray, moving: np.ndarray) -> RestPoint:
        return RestPoint(*parts(z), desired, np.isin(np.arange(3, 3 + count), moving))

    whole, bent = np.arange(3 + count), np.arange(3 + count, len(start))
    frozen = _newton(balance, start, np.arange(3), bent)
    if frozen is not None and _rests(balance(frozen)):
        return rest_point(frozen, whole[:0])
    begin = start if frozen is None else frozen
    settling = np.setdiff1d(whole, 3 + probe.growing)
    for free in (np.concatenate([whole[:3], 3 + probe.observed]), settling, whole):
        found = _newton(balance, begin, free, bent) if len(free) > 3 else None
        if found is not None and _rests(balance(found)):
            return rest_point(found, whole[:0])
    found = _newton(balance, begin, settling, bent) if len(settling) > 3 else None
    if found is not None:
        return rest_point(found, 3 + probe.growing)
    if frozen is None:
        pose = f"x = {target[0]:.3f} m, y = {target[1]:.3f} m, θ = {target[2]:.3f} rad"
        raise StudyError(
            f"The loop has no rest point near {pose}: the motors do not hold the weight there. "
            "Choose a law that holds the arms, higher gains, or no gravity."
        )
    return rest_point(frozen, whole[3:])


def _rests(unbalance: np.ndarray) -> bool:
    return bool(np.abs(unbalance).max() < BALANCED)


def _newton(balance, start: np.ndarray, free: np.ndarray, bent: np.ndarray) -> np.ndarray | None:
    """Return the zero of the equations numbered `free` and `bent` in the unknowns of the same numbers, or None.

    Redundant unknowns in `free` change least; those in `bent` follow from `free`.
    """
    z, unknowns = start.copy(), np.concatenate([free, bent])
    for _ in range(MOST_STEPS):
        try:
            left = balance(z)[unknowns]
            if _rests(left):
                return z
            slope = np.empty((len(unknowns), len(unknowns)))
            for column, unknown in enumerate(unknowns):
                step = DIFFERENCE * np.eye(len(z))[unknown]
                slope[:, column] = (balance(z + step) - balance(z - step))[unknowns] / (2 * DIFFERENCE)
        except StudyError:
            return None
        A, B, C, D = (part for rows in np.split(slope, [len(free)]) for part in np.split(rows, [len(free)], axis=1))
        force, rest = np.split(left, [len(free)])
        try:
            follow = np.linalg.solve(D, np.column_stack([C, rest]))
        except np.linalg.LinAlgError:
            return None
        change = -np.linalg.lstsq(A - B @ follow[:, :-1], force - B @ follow[:, -1], rcond=1e-12)[0]
        change = np.concatenate([change, -follow[:, -1] - follow[:, :-1] @ change])
        if not np.all(np.isfinite(change)):
            return None
        z[unknowns] += change / max(1.0, np.abs(change[:3]).max() / LONGEST_STEP)
    return None
