"""A scenario in motion: what is derived from it, and all that changes with time."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from flexlab.compiled import attributes
from flexlab.control.law import Start, law_of
from flexlab.errors import StudyError
from flexlab.numerics.linear_algebra import product
from flexlab.physics.arm import task_input
from flexlab.physics.dynamics import arms_at, set_momenta, velocities_at
from flexlab.physics.grips import begin_grips, measured_motion
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import ETA, Workspace, forget_rates
from flexlab.physics.sensors import begin_reading
from flexlab.scenario import Scenario
from flexlab.scenario.scenario import Initial
from flexlab.sim import accuracy, samples
from flexlab.sim.assembly import Assembly
from flexlab.sim.build import Beam
from flexlab.sim.closed_loop import System, law_input_at, memory_slice, new_workspace, own_states_of, state_length
from flexlab.sim.disturbance import set_pull_row, without_hand
from flexlab.sim.sampled_control import control_instant
from flexlab.sim.samples import Status, WorldState
from flexlab.sim.signals import own_signals
from flexlab.sim.target import desired_at
from flexlab.sim.termination import check_trajectory, pose_fault

LATE = 1e-9
"""Rounding error of an instant, as a share of a control period."""


@dataclass
class Motion:
    """The state of a scenario in motion. `stepping` moves it, `bumpless_transfer` changes its constants."""

    assembly: Assembly
    """What is derived from the scenario; the held torques, those under way and the hand in it change with time."""
    y: np.ndarray
    """State of `physics.plant`."""
    workspace: Workspace
    """The kernels' scratch arrays, and the flag by which another thread interrupts them. A change of the path voids the desired
    motion that they remember."""
    estimate: accuracy.Estimate
    """What is known of the run's accuracy."""
    tick: int = 0
    """Number of the present instant."""
    level: int = 0
    """Number of times the step is halved."""
    status: Status = field(default_factory=lambda: Status("running", "Running."))
    move: Callable[..., Any] | None = None
    """The compiled entry point of `advance` for these constants' types, once there is one."""

    @property
    def scenario(self) -> Scenario:
        """The scenario in motion."""
        return self.assembly.scenario

    @property
    def tick_period(self) -> float:
        """Time between two samples, s."""
        return self.assembly.tick_period

    @property
    def time(self) -> float:
        """Simulation time, s: exactly tick · tick_period."""
        return self.tick * self.tick_period

    @property
    def row_length(self) -> int:
        """Columns of a sample row."""
        coordinates = self.assembly.beam.modes.V.shape[0]
        return samples.row_length(len(self.scenario.arms), coordinates, own_signals(self.scenario))

    def law_start(self, acts_now: bool) -> Start | None:
        """What the law sees at the present instant, as `law_start`."""
        return law_start(self.scenario, self.assembly.system, self.time, self.y, self.workspace, acts_now)


def begin_motion(assembly: Assembly, tick: int = 0) -> Motion:
    """The motion of an assembly from its start, or from a later tick on the desired path; nobody holds beam or links.

    Its status has failed if the desired path or the start pose cannot be reached.
    """
    plant, line = without_hand(assembly.system.plant), np.zeros_like(assembly.sampling.line)
    system = assembly.system._replace(plant=plant, held_torque=np.zeros_like(assembly.system.held_torque))
    assembly = assembly._replace(system=system, sampling=assembly.sampling._replace(line=line))
    y, workspace = np.zeros(state_length(system)), new_workspace(system)
    motion = Motion(assembly, y, workspace, accuracy.nothing_yet(assembly, 0), tick)
    motion.status = _start(motion) or motion.status
    return motion


def _start(motion: Motion) -> Status | None:
    """Set the state at the start; returns the fault that forbids it."""
    scenario, system = motion.scenario, motion.assembly.system
    initial, desired = scenario.initial, desired_at(system.trajectory, motion.time)
    if motion.tick > 0:
        initial = Initial(pose_rate=None)
    pose = desired[0] if initial.pose is None else np.array(initial.pose)
    rate = desired[1] if initial.pose_rate is None else np.array(initial.pose_rate)
    fault = check_trajectory(scenario) or pose_fault(scenario, pose, 0.0, "the start pose")
    if fault is not None:
        motion.y[:3] = pose
        return fault
    q = (
        np.zeros(system.plant.shapes.shape[1])
        if initial.beam_coordinates is None
        else np.array(initial.beam_coordinates)
    )
    eta = to_modes(motion.assembly.beam, q)
    begin_grip_states(motion.assembly, motion.y, rate)
    set_coordinates(motion, pose, rate, eta, np.zeros_like(eta))
    start_controller(scenario, system, motion.law_start(True), motion.y)
    act_at_start(motion)
    return None


def to_modes(beam: Beam, q: np.ndarray) -> np.ndarray:
    """η = VᵀM_q q."""
    return product(product(beam.matrices.M_q, q), beam.modes.V)


def begin_grip_states(assembly: Assembly, y: np.ndarray, rate: np.ndarray) -> None:
    """Start the states of compliant grips for a payload that moves with this pose rate (3,), in place."""
    if assembly.system.plant.grips is not None:
        begin_grips(assembly.system.plant, own_states_of(assembly.system, y)["grips"], rate)


def set_coordinates(motion: Motion, pose: np.ndarray, rate: np.ndarray, eta: np.ndarray, eta_dot: np.ndarray) -> None:
    """Set pose and modal coordinates with their rates; the momenta follow."""
    n = len(eta)
    motion.y[:3] = pose
    motion.y[ETA : ETA + n] = eta
    forget_rates(motion.y, n)
    find_mass_at(motion.assembly.system.plant, motion.time, motion.workspace)
    set_momenta(motion.assembly.system.plant, motion.y, rate, eta_dot, motion.workspace)


def controller_states(scenario: Scenario, system: System, y: np.ndarray) -> dict[str, np.ndarray]:
    """Views of the named parts of the controller's state in y."""
    memory = y[memory_slice(system)]
    slices = law_of(scenario.controller).memory_slices(len(scenario.arms))
    return {name: memory[part] for name, part in slices.items()}


def law_start(
    scenario: Scenario, system: System, time: float, y: np.ndarray, ws: Workspace, acts_now: bool
) -> Start | None:
    """What the law sees at the state y; None if it does not use it. `acts_now`: whether a sampled law acts at this instant."""
    law = law_of(scenario.controller)
    if law.start is None and law.bumpless_transfer is None:
        return None
    control, period = system.control, scenario.controller.control_period
    find_mass_at(system.plant, time, ws)
    velocities_at(system.plant, y, ws)
    x, v = y[:3], ws.velocity
    if system.plant.grips is not None:
        x, v = measured_motion(system.plant, y, own_states_of(system, y)["grips"], v.copy())
        arms_at(system.plant, x, ws)
    for i in range(len(system.plant.arms)):
        task_input(ws.arm.J[i], system.held_torque[i], ws.u[i])
    now = law_input_at(system, x, v, desired_at(system.trajectory, time), ws)
    gains = attributes(control.gains, law.gains_type)
    wait = 0.0
    if period is not None and not acts_now:
        wait = until_next(period, time)
    return Start(now.copy(), gains, wait)


def until_next(period: float, time: float) -> float:
    """Time from an instant, s, to the next control instant after it, s, at most `period`, s."""
    return (math.floor(time / period + LATE) + 1) * period - time


def start_controller(
    scenario: Scenario, system: System, begin: Start | None, y: np.ndarray, kept: tuple[str, ...] = ()
) -> None:
    """Set the controller's state in y to the values with which the law begins, except for the parts in `kept`."""
    law = law_of(scenario.controller)
    if law.start is None or begin is None:
        return
    parts = controller_states(scenario, system, y)
    for name, values in law.start(begin).items():
        if name not in kept:
            parts[name][:] = values


def act_at_start(motion: Motion) -> None:
    """Let a sampled controller act for the first time."""
    assembly = motion.assembly
    if assembly.system.control.sampled:
        find_mass_at(assembly.system.plant, motion.time, motion.workspace)
        begin_reading(assembly.system.plant, assembly.sampling.period, motion.y, motion.workspace)
        control_instant(assembly.system, assembly.sampling, 0, motion.time, motion.y, motion.workspace)


def state_of(motion: Motion) -> WorldState:
    """A copy of all that changes with time."""
    assembly = motion.assembly
    return WorldState(
        motion.tick,
        motion.y.copy(),
        assembly.system.held_torque.copy(),
        assembly.sampling.line.copy(),
        assembly.system.plant.pull.copy(),
    )


def restore(motion: Motion, state: WorldState) -> None:
    """Go back, or on, to a state of the same scenario. Raises `StudyError`, and changes nothing, for any other state."""
    own = state_of(motion)
    for part in fields(WorldState):
        given, fitting = np.shape(getattr(state, part.name)), np.shape(getattr(own, part.name))
        if given != fitting:
            raise StudyError(
                f"This state does not fit its scenario: {part.name} has the shape {given}, not {fitting}. "
                "Take scenario and state from the same instant of one run."
            )
    assembly = motion.assembly
    motion.tick = state.tick
    motion.y = state.y.copy()
    assembly.system.held_torque[:] = state.held_torque
    assembly.sampling.line[:] = state.torque_line
    assembly.system.plant.pull[:] = state.pull
    set_pull_row(assembly.system.plant, motion.scenario.payload, assembly.beam)
    motion.workspace = new_workspace(assembly.system)
    motion.estimate = accuracy.nothing_yet(assembly, motion.tick)
    motion.status = Status("running", "Running.")
