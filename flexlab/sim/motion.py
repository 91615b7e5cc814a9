"""A scenario in motion: what is derived from it, and all that changes with time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from flexlab.control.law import Start
from flexlab.errors import StudyError
from flexlab.numerics.linear_algebra import product
from flexlab.physics.dynamics import set_momenta
from flexlab.physics.grips import begin_grips
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import ETA, Workspace, forget_rates
from flexlab.physics.sensors import begin_reading
from flexlab.scenario import Scenario
from flexlab.scenario.scenario import Initial
from flexlab.sim import accuracy, samples
from flexlab.sim.assembly import Assembly, build_assembly
from flexlab.sim.build import Beam
from flexlab.sim.closed_loop import new_workspace, own_states_of, state_length
from flexlab.sim.disturbance import set_pull_row, without_hand
from flexlab.sim.law_memory import outlook, start_memory
from flexlab.sim.sampled_control import control_instant
from flexlab.sim.samples import Status
from flexlab.sim.signals import own_signals
from flexlab.sim.target import desired_at
from flexlab.sim.termination import pose_fault
from flexlab.sim.workspace_check import check_trajectory
from flexlab.sim.world_state import WorldState


@dataclass
class Motion:
    """Where a scenario's run stands. `stepping` moves it, `carry_over` has it go on with other constants."""

    scenario: Scenario
    tick_period: float
    """s."""
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
    """How often the step is halved."""
    status: Status = field(default_factory=lambda: Status("running", "Running."))
    move: Callable[..., Any] | None = None
    """The compiled entry point of `advance` for these constants' types, once there is one."""

    @property
    def time(self) -> float:
        """Simulation time, s: exactly tick · tick_period."""
        return self.tick * self.tick_period

    @property
    def row_length(self) -> int:
        """Columns of a sample row."""
        coordinates = self.assembly.beam.modes.V.shape[0]
        return samples.row_length(len(self.scenario.arms), coordinates, own_signals(self.scenario))


def begin_motion(scenario: Scenario, tick_period: float, known: Sequence[Assembly], at_once: bool) -> Motion:
    """A checked scenario at t = 0; its status has failed if trajectory or start pose cannot be reached.

    `known` and `at_once` as for `build_assembly`, whose errors it raises.
    """
    assembly = build_assembly(scenario, tick_period, known, at_once)
    # What is known may belong to a world whose beam or link somebody holds.
    assembly = assembly._replace(system=assembly.system._replace(plant=without_hand(assembly.system.plant)))
    y, workspace = np.zeros(state_length(assembly.system)), new_workspace(assembly.system)
    motion = Motion(scenario, tick_period, assembly, y, workspace, accuracy.nothing_yet(assembly, 0))
    motion.status = _start(motion) or motion.status
    return motion


def start_at(assembly: Assembly, tick_period: float, tick: int) -> Motion | None:
    """An assembly's motion as it begins, or at a later tick on the desired path with nothing behind it; None: it cannot."""
    line = np.zeros_like(assembly.sampling.line)
    system = assembly.system._replace(held_torque=np.zeros_like(assembly.system.held_torque))
    system = system._replace(plant=without_hand(system.plant))
    assembly = assembly._replace(system=system, sampling=assembly.sampling._replace(line=line))
    y, workspace = np.zeros(state_length(system)), new_workspace(system)
    motion = Motion(assembly.scenario, tick_period, assembly, y, workspace, accuracy.nothing_yet(assembly, 0))
    motion.tick = tick
    return None if _start(motion) else motion


def _start(motion: Motion) -> Status | None:
    """Set the state at t = 0; returns the fault that forbids it."""
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
    hold(motion.assembly, motion.y, rate)
    set_coordinates(motion, pose, rate, eta, np.zeros_like(eta))
    start_memory(scenario, system, outlook_of(motion, True), motion.y)
    act_at_start(motion)
    return None


def to_modes(beam: Beam, q: np.ndarray) -> np.ndarray:
    """η = VᵀM_q q."""
    return product(product(beam.matrices.M_q, q), beam.modes.V)


def hold(assembly: Assembly, y: np.ndarray, rate: np.ndarray) -> None:
    """Let grips that give way begin to hold a payload that moves with this pose rate (3,), in place."""
    if assembly.system.plant.grips is not None:
        begin_grips(assembly.system.plant, own_states_of(assembly.system, y)["grips"], rate)


def set_coordinates(motion: Motion, pose: np.ndarray, rate: np.ndarray, eta: np.ndarray, eta_dot: np.ndarray) -> None:
    """Put plant and beam where they are to be, with these velocities; the momenta follow."""
    n = len(eta)
    motion.y[:3] = pose
    motion.y[ETA : ETA + n] = eta
    forget_rates(motion.y, n)
    find_mass_at(motion.assembly.system.plant, motion.time, motion.workspace)
    set_momenta(motion.assembly.system.plant, motion.y, rate, eta_dot, motion.workspace)


def outlook_of(motion: Motion, acts_now: bool) -> Start | None:
    """What the law sees at the present instant, as `law_memory.outlook`."""
    return outlook(motion.scenario, motion.assembly.system, motion.time, motion.y, motion.workspace, acts_now)


def act_at_start(motion: Motion) -> None:
    """Let a sampled controller act at its instant 0."""
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
    """Stand where a state of the same scenario says. Raises `StudyError`, and changes nothing, for any other state."""
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
