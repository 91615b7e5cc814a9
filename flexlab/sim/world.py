"""The simulated world: deterministic stepping, no clock, no thread.

Same scenario and same commands at the same ticks give the same bits, whatever the sizes of the blocks it is advanced by.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flexlab.errors import ScenarioError
from flexlab.physics.plant import ETA, Plant, Workspace, find_velocities, make_workspace, set_momenta, state_size
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim import columns
from flexlab.sim.advance import advance
from flexlab.sim.blas import one_blas_thread
from flexlab.sim.build import Beam, build_beam, build_system, desired_at, payload_row
from flexlab.sim.closed_loop import System
from flexlab.sim.commands import ChangeScenario, Pull, Tap, WorldCommand
from flexlab.sim.faults import DEFLECTION_LIMIT, pose_fault, runtime_fault
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.observe import observe
from flexlab.sim.projection import project_beam
from flexlab.sim.sampled_control import Sampling, control_instant
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import TICK
from flexlab.sim.timing import build_scheme, choose_step, steps_per_tick
from flexlab.sim.workspace_check import check_trajectory

RESTARTING = ("payload.length", "left_arm", "right_arm", "initial")
"""Fields whose change a running world cannot take on: the run starts anew."""


@dataclass(frozen=True)
class WorldState:
    """Everything that changes with time, copied: enough to continue a run bit for bit in the same scenario."""

    tick: int
    y: np.ndarray
    """State of `physics.plant`."""
    held_torque: np.ndarray
    """(arms, 3), N·m."""
    torque_line: np.ndarray
    """(delay + 1, arms, 3), N·m."""
    pull: np.ndarray
    """s, target x, target y, stiffness, (4,)."""


class _Machinery(NamedTuple):
    """What is derived from a scenario."""

    beam: Beam
    system: System
    sampling: Sampling
    scheme: Scheme
    step_count: int
    integrator: str


class World:
    """One scenario in motion. `advance` moves it, `apply` changes it; both leave it whole when they refuse."""

    def __init__(self, scenario: Scenario, tick_period: float = TICK):
        """Build and check; raises `ScenarioError` if the scenario is not valid.

        An unreachable trajectory or start pose is no error but a world whose `status` has failed.
        """
        self.scenario = parse_scenario(scenario.model_dump())
        self.tick_period = tick_period
        self.tick = 0
        self._machinery = _build(self.scenario, tick_period)
        self._y = np.zeros(state_size(len(self._machinery.beam.modes.omega)))
        self._workspace = self._new_workspace()
        self.status = Status("running", "Running.")
        fault = self._start()
        if fault is not None:
            self.status = fault

    def _new_workspace(self) -> Workspace:
        return make_workspace(len(self.scenario.arms), len(self._machinery.beam.modes.omega))

    def _start(self) -> Status | None:
        """Set the state at t = 0; returns the fault that forbids it."""
        initial, plant = self.scenario.initial, self._machinery.system.plant
        desired = desired_at(self._machinery.system.trajectory, 0.0)
        pose = desired[0] if initial.pose is None else np.array(initial.pose)
        rate = desired[1] if initial.pose_rate is None else np.array(initial.pose_rate)
        fault = check_trajectory(self.scenario) or pose_fault(self.scenario, pose, 0.0, "the start pose")
        if fault is not None:
            self._y[:3] = pose
            return fault
        q = np.zeros(plant.V.shape[0]) if initial.beam_coordinates is None else np.array(initial.beam_coordinates)
        eta = _to_modes(self._machinery.beam, q)
        self._set_motion(pose, rate, eta, np.zeros_like(eta))
        self._act_at_start()
        return None

    def _act_at_start(self) -> None:
        """Let a sampled controller act at its instant 0."""
        machinery = self._machinery
        if machinery.system.control.sampled:
            control_instant(machinery.system, machinery.sampling, 0, self.time, self._y, self._workspace)

    def _set_motion(self, pose: np.ndarray, rate: np.ndarray, eta: np.ndarray, eta_dot: np.ndarray) -> None:
        n = len(eta)
        self._y[:3] = pose
        self._y[ETA : ETA + n] = eta
        self._y[ETA + 2 * n :] = np.nan  # generalized-alpha finds its first accelerations itself
        set_momenta(self._machinery.system.plant, self._y, rate, eta_dot, self._workspace)

    @property
    def time(self) -> float:
        """Simulation time, s: exactly tick · tick_period."""
        return self.tick * self.tick_period

    @property
    def step(self) -> float:
        """The integration step in use, s."""
        return self.tick_period / self._machinery.step_count

    @property
    def integrator(self) -> str:
        """The integrator in use."""
        return self._machinery.integrator

    @property
    def beam(self) -> Beam:
        """Matrices and modes of the payload."""
        return self._machinery.beam

    @property
    def system(self) -> System:
        """The kernels' constants, for studies of the same world (do not change them)."""
        return self._machinery.system

    @property
    def first_frequency(self) -> float:
        """f1 of the payload with its grips held, Hz."""
        return float(np.min(self._machinery.beam.modes.omega)) / (2 * np.pi)

    def observe(self) -> Samples:
        """The sample of the present instant (N = 1); of a failed start: the pose alone, the rest zero."""
        return columns.rows_to_samples(self.observe_rows(), len(self.scenario.arms))

    def observe_rows(self) -> np.ndarray:
        """As `observe`, as a row (1, row length) in the layout of `sim.columns`."""
        rows = self.new_rows(1)
        self._observe(rows[0])
        return rows

    @property
    def row_length(self) -> int:
        """Columns of a sample row: changes with arms and mesh only."""
        return columns.row_length(len(self.scenario.arms), self._machinery.beam.modes.V.shape[0])

    def _observe(self, row: np.ndarray) -> None:
        observe(self._machinery.system, self.time, self._y, self._workspace, row)
        row[columns.TIME] = self.time
        row[columns.POSE : columns.POSE + 3] = self._y[:3]

    def new_rows(self, count: int) -> np.ndarray:
        """Room for `count` samples, (count, row length)."""
        return np.zeros((count, self.row_length))

    def advance(self, ticks: int) -> Samples:
        """Move by up to `ticks` sample periods; the samples of the instants reached, the present one not included.

        Fewer than `ticks` rows mean that the world stopped: `status` says why, and the state is the last good one.
        """
        return columns.rows_to_samples(self.advance_rows(ticks), len(self.scenario.arms))

    def advance_rows(self, ticks: int) -> np.ndarray:
        """As `advance`, as rows (ticks done, row length) in the layout of `sim.columns`."""
        rows = self.new_rows(0 if self.status.failed else ticks)
        return rows[: self.fill(rows)]

    def run(self, ticks: int) -> Samples:
        """As `advance`, with the present instant as first sample."""
        rows = self.new_rows(1 if self.status.failed else ticks + 1)
        self._observe(rows[0])
        done = self.fill(rows[1:])
        return columns.rows_to_samples(rows[: done + 1], len(self.scenario.arms))

    def fill(self, rows: np.ndarray) -> int:
        """Move by one tick per row of rows (ticks, row length), writing the samples there; returns the ticks done."""
        if self.status.failed:
            return 0
        machinery = self._machinery
        done, code = advance(
            machinery.system,
            machinery.sampling,
            machinery.scheme,
            DEFLECTION_LIMIT * self.scenario.payload.length,
            self.tick,
            self.tick_period,
            machinery.step_count,
            self._y,
            np.empty_like(self._y),
            self._workspace,
            rows,
        )
        self.tick += done
        if code != 0:
            find_velocities(machinery.system.plant, self._y, self._workspace)
            rate = self._workspace.velocity
            self.status = runtime_fault(self.scenario, code, self._y[:3], rate, self.time, self.tick_period)
        return done

    def apply(self, command: WorldCommand) -> bool:
        """Carry out a command at the present instant; returns whether the world started anew.

        Raises `ScenarioError` (and changes nothing) for values that are not valid or a motion that cannot be reached.
        """
        if isinstance(command, ChangeScenario):
            return self._change(command.changes)
        if isinstance(command, Pull):
            self._pull(command)
        elif isinstance(command, Tap):
            self._tap(command)
        return False

    def _change(self, changes: Mapping[str, Any]) -> bool:
        scenario = _keep_phase(self.scenario, changes, self.time)
        fault = check_trajectory(scenario)
        if fault is not None:
            raise ScenarioError([("trajectory", fault.text)])
        if any(path.startswith(RESTARTING) for path in changes) or len(scenario.arms) != len(self.scenario.arms):
            self.__init__(scenario, self.tick_period)
            return True
        machinery = _build(scenario, self.tick_period)
        self._carry_over(scenario, machinery)
        return False

    def _carry_over(self, scenario: Scenario, machinery: _Machinery) -> None:
        """Go on with new machinery: coordinates and velocities stay, momenta follow."""
        old, plant = self._machinery, self._machinery.system.plant
        n = plant.modal.shape[1]
        find_velocities(plant, self._y, self._workspace)
        rate, eta_dot = self._workspace.velocity.copy(), self._workspace.eta_dot.copy()
        q, q_dot = plant.V @ self._y[ETA : ETA + n], plant.V @ eta_dot
        same_mesh = (
            scenario.payload.element_count == self.scenario.payload.element_count
            and scenario.payload.boundary == self.scenario.payload.boundary
        )
        if not same_mesh:
            q = project_beam(self.scenario.payload, scenario.payload, machinery.beam.matrices.M_q, q)
            q_dot = project_beam(self.scenario.payload, scenario.payload, machinery.beam.matrices.M_q, q_dot)
        y = np.zeros(state_size(len(machinery.beam.modes.omega)))
        y[:ETA] = self._y[:ETA]
        machinery.system.plant.pull[:] = plant.pull
        _set_pull_row(machinery.system.plant, scenario, machinery.beam)
        machinery.system.held_torque[:] = old.system.held_torque
        if machinery.sampling.line.shape == old.sampling.line.shape:
            machinery.sampling.line[:] = old.sampling.line
        self.scenario, self._machinery, self._y = scenario, machinery, y
        self._workspace = self._new_workspace()
        eta, eta_dot = _to_modes(machinery.beam, q), _to_modes(machinery.beam, q_dot)
        self._set_motion(y[:3].copy(), rate, eta, eta_dot)
        if machinery.system.control.sampled and not old.system.control.sampled:
            self._act_at_start()

    def _pull(self, command: Pull) -> None:
        _check_point(self.scenario, command.beam_position)
        values = (command.beam_position, *command.target, command.stiffness)
        if not all(np.isfinite(values)) or not 0 <= command.stiffness <= MAX_PULL_STIFFNESS:
            raise ScenarioError(
                [("pull", f"pull stiffness = {command.stiffness:g} N/m is outside 0 to {MAX_PULL_STIFFNESS:g} N/m.")]
            )
        plant = self._machinery.system.plant
        plant.pull[:] = values
        _set_pull_row(plant, self.scenario, self._machinery.beam)

    def _tap(self, command: Tap) -> None:
        _check_point(self.scenario, command.beam_position)
        size = float(np.hypot(*command.impulse))
        if not size <= MAX_IMPULSE:
            raise ScenarioError([("tap", f"tap = {size:g} N·s is more than the {MAX_IMPULSE:g} N·s allowed.")])
        plant, y = self._machinery.system.plant, self._y
        n = plant.modal.shape[1]
        shape = self._machinery.beam.modes.V.T @ payload_row(self.scenario.payload, command.beam_position)
        c, s = np.cos(y[2]), np.sin(y[2])
        along = c * command.impulse[0] + s * command.impulse[1]
        across = c * command.impulse[1] - s * command.impulse[0]
        deflection = float(shape @ y[ETA : ETA + n])
        # Momenta take an impulse directly: (P, π) += (∂R/∂p)ᵀ impulse.
        y[3:5] += command.impulse
        y[5] += command.beam_position * across - deflection * along
        y[ETA + n : ETA + 2 * n] += shape * across

    def state(self) -> WorldState:
        """A copy of all that changes with time."""
        machinery = self._machinery
        return WorldState(
            self.tick,
            self._y.copy(),
            machinery.system.held_torque.copy(),
            machinery.sampling.line.copy(),
            machinery.system.plant.pull.copy(),
        )

    def restore(self, state: WorldState) -> None:
        """Go on from a `WorldState` of the same scenario."""
        self.tick = state.tick
        self._y = state.y.copy()
        self._machinery.system.held_torque[:] = state.held_torque
        self._machinery.sampling.line[:] = state.torque_line
        self._machinery.system.plant.pull[:] = state.pull
        _set_pull_row(self._machinery.system.plant, self.scenario, self._machinery.beam)
        self._workspace = self._new_workspace()
        self.status = Status("running", "Running.")


MAX_PULL_STIFFNESS = 1e5
"""N/m: stiffer pulls would outdo the controller and need shorter steps."""

MAX_IMPULSE = 100.0
"""N·s: a hammer blow; more than that only destroys the run."""


def _build(scenario: Scenario, tick_period: float) -> _Machinery:
    """Derive everything from a scenario; raises `ScenarioError`."""
    with one_blas_thread():
        return _derive(scenario, tick_period)


def _derive(scenario: Scenario, tick_period: float) -> _Machinery:
    beam = build_beam(scenario.payload)
    system = build_system(scenario, beam)
    integrator, step = choose_step(scenario, system, beam)
    count, per_control = steps_per_tick(scenario, tick_period, step)
    law, noise = scenario.controller, scenario.controller.sensor_noise
    # A strain gauge's noise reaches hᵀq̇ and gᵀq̇ in proportion to the loads they weigh.
    strain = noise.strain * np.array([beam.matrices.m, beam.matrices.m * scenario.payload.length])
    sampling = Sampling(
        law.control_period or 0.0,
        max(per_control, 1),
        law.input_delay,
        np.concatenate([noise.pose, noise.pose_rate, strain]).astype(float),
        noise.seed,
        np.zeros((law.input_delay + 1, len(scenario.arms), 3)),
    )
    return _Machinery(beam, system, sampling, build_scheme(integrator, beam, tick_period / count), count, integrator)


def _to_modes(beam: Beam, q: np.ndarray) -> np.ndarray:
    """η = VᵀM_q q."""
    return beam.modes.V.T @ (beam.matrices.M_q @ q)


def _set_pull_row(plant: Plant, scenario: Scenario, beam: Beam) -> None:
    plant.modal[-1] = beam.modes.V.T @ payload_row(scenario.payload, plant.pull[0])


def _check_point(scenario: Scenario, s: float) -> None:
    half = scenario.payload.length / 2
    if not abs(s) <= half:
        raise ScenarioError(
            [("beam_position", f"beam position = {s:g} m is not on the beam: choose {-half:g} to {half:g} m.")]
        )


def _keep_phase(scenario: Scenario, changes: Mapping[str, Any], time: float) -> Scenario:
    """The changed scenario; a new frequency alone keeps the sine's argument, so that the target does not jump."""
    changed = scenario.replace(changes)
    old, new = scenario.trajectory, changed.trajectory
    if old.frequency == new.frequency or "trajectory.phase" in changes:
        return changed
    turn = 2 * np.pi
    phase = tuple(
        float(np.remainder(p + turn * (f0 - f1) * time, turn)) if f0 != f1 else p
        for p, f0, f1 in zip(old.phase, old.frequency, new.frequency, strict=True)
    )
    return changed.replace({"trajectory.phase": phase})
