"""The simulated world: deterministic stepping, no clock, no thread.

Same scenario and same commands at the same ticks give the same bits, whatever the sizes of the blocks it is advanced by.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from flexlab.compiled import entry_point
from flexlab.control.law import Start
from flexlab.errors import ScenarioError, StudyError
from flexlab.physics.dynamics import set_momenta, velocities_at
from flexlab.physics.plant import ETA, forget_rates, noted_rates
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim import accuracy, row_layout
from flexlab.sim.advance import INTERRUPTED, OTHER_STEP, advance
from flexlab.sim.assembly import Assembly, build_assembly
from flexlab.sim.build import Beam
from flexlab.sim.closed_loop import System, new_workspace, state_length
from flexlab.sim.commands import ChangeScenario, Pull, WorldCommand
from flexlab.sim.disturbance import apply_pull, apply_tap, set_pull_row, without_hand
from flexlab.sim.integrators.beam_flow import TICKS
from flexlab.sim.kinks import advance_in_pieces, next_tick_of_kinks
from flexlab.sim.law_memory import adjust_memory, carry_memory, outlook, same_law, start_memory
from flexlab.sim.pace import pace_warning
from flexlab.sim.projection import project_beam
from flexlab.sim.sampled_control import control_instant
from flexlab.sim.samples import Samples, Status
from flexlab.sim.signals import own_signals
from flexlab.sim.snapshot import TICK
from flexlab.sim.step_levels import DISTURBED_TICKS
from flexlab.sim.target import change_path, desired_at, equal_motions, go_on_from
from flexlab.sim.termination import DEFLECTION_LIMIT, pose_fault, runtime_fault
from flexlab.sim.workspace_check import check_trajectory, same_reach
from flexlab.sim.world_state import WorldState


class World:
    """One scenario in motion. `advance` moves it, `apply` changes it; both leave it whole when they refuse."""

    def __init__(
        self, scenario: Scenario, tick_period: float = TICK, known: Sequence[Assembly] = (), at_once: bool = False
    ):
        """Build and check; raises `ScenarioError` if the scenario is not valid.

        An unreachable trajectory or start pose is no error but a world whose `status` has failed. `known` and `at_once` as
        for `apply`.
        """
        self.scenario = parse_scenario(scenario.model_dump())
        self.tick_period = tick_period
        self.tick = 0
        self._level = 0
        assembly = build_assembly(self.scenario, tick_period, known, at_once)
        # What is known may belong to a world whose beam or link somebody holds.
        self._assembly = assembly._replace(system=assembly.system._replace(plant=without_hand(assembly.system.plant)))
        self._y = np.zeros(state_length(self._assembly.system))
        self._workspace = new_workspace(self._assembly.system)
        self._move: Callable[..., Any] | None = None
        self.status = Status("running", "Running.")
        self._estimate = accuracy.nothing_yet(self._assembly, 0)
        fault = self._start()
        if fault is not None:
            self.status = fault

    def _start(self) -> Status | None:
        """Set the state at t = 0; returns the fault that forbids it."""
        initial, plant = self.scenario.initial, self._assembly.system.plant
        desired = desired_at(self._assembly.system.trajectory, 0.0)
        pose = desired[0] if initial.pose is None else np.array(initial.pose)
        rate = desired[1] if initial.pose_rate is None else np.array(initial.pose_rate)
        fault = check_trajectory(self.scenario) or pose_fault(self.scenario, pose, 0.0, "the start pose")
        if fault is not None:
            self._y[:3] = pose
            return fault
        q = np.zeros(plant.V.shape[0]) if initial.beam_coordinates is None else np.array(initial.beam_coordinates)
        eta = _to_modes(self._assembly.beam, q)
        self._set_motion(pose, rate, eta, np.zeros_like(eta))
        start_memory(self.scenario, self.system, self._outlook(True), self._y)
        self._act_at_start()
        return None

    def _outlook(self, acts_now: bool) -> Start | None:
        """What the law sees at the present instant, as `law_memory.outlook`."""
        return outlook(self.scenario, self.system, self.time, self._y, self._workspace, acts_now)

    def _act_at_start(self) -> None:
        """Let a sampled controller act at its instant 0."""
        assembly = self._assembly
        if assembly.system.control.sampled:
            control_instant(assembly.system, assembly.sampling, 0, self.time, self._y, self._workspace)

    def _set_motion(self, pose: np.ndarray, rate: np.ndarray, eta: np.ndarray, eta_dot: np.ndarray) -> None:
        n = len(eta)
        self._y[:3] = pose
        self._y[ETA : ETA + n] = eta
        forget_rates(self._y, n)
        set_momenta(self._assembly.system.plant, self._y, rate, eta_dot, self._workspace)

    @property
    def time(self) -> float:
        """Simulation time, s: exactly tick · tick_period."""
        return self.tick * self.tick_period

    @property
    def step(self) -> float:
        """The integration step in use, s."""
        return self._assembly.levels.step / 2**self._level

    @property
    def accuracy_warning(self) -> str:
        """Since when and why results are no longer accurate, a sentence; empty: they are."""
        return self._estimate.warning

    @property
    def pace_warning(self) -> str:
        """What makes the run slower than real time, and what to change, a sentence; empty: nothing, by an estimate."""
        assembly = self._assembly
        n, watch = len(assembly.beam.modes.omega), assembly.watch
        settled = not self._y[ETA + 2 * n + TICKS] < DISTURBED_TICKS * watch.disturbed
        growing = self._level > 0 and settled
        bound = "law" if growing else assembly.bound
        level = self._level if growing else 0
        return pace_warning(self.integrator, assembly.beam, assembly.levels.step / 2**level, bound)

    @property
    def integrator(self) -> str:
        """The integrator in use."""
        return self._assembly.levels.integrator

    @property
    def beam(self) -> Beam:
        """Matrices and modes of the payload."""
        return self._assembly.beam

    @property
    def system(self) -> System:
        """The kernels' constants, for studies of the same world (do not change them)."""
        return self._assembly.system

    @property
    def assembly(self) -> Assembly:
        """All that is derived from the scenario, for worlds to come (do not change it)."""
        return self._assembly

    @property
    def first_frequency(self) -> float:
        """f1 of the payload with its grips held, Hz."""
        return float(np.min(self._assembly.beam.modes.omega)) / (2 * np.pi)

    def observe(self) -> Samples:
        """The sample of the present instant (N = 1); of a failed start: the pose alone, the rest zero."""
        return self.to_samples(self.observe_rows())

    def observe_rows(self) -> np.ndarray:
        """As `observe`, as a row (1, row length) in the layout of `sim.row_layout`."""
        rows = self.new_rows(1)
        self._observe(rows[0])
        return rows

    @property
    def row_length(self) -> int:
        """Columns of a sample row: changes with arms, mesh and the law's own signals only."""
        own = own_signals(self.scenario)
        return row_layout.row_length(len(self.scenario.arms), self._assembly.beam.modes.V.shape[0], own)

    def to_samples(self, rows: np.ndarray) -> Samples:
        """Views of the signals in rows (N, row length) of this world."""
        return row_layout.rows_to_samples(rows, len(self.scenario.arms), own_signals(self.scenario))

    def _observe(self, row: np.ndarray) -> None:
        self._advance(row[None], first_is_present=True)
        row[row_layout.TIME] = self.time
        row[row_layout.POSE : row_layout.POSE + 3] = self._y[:3]

    def new_rows(self, count: int) -> np.ndarray:
        """Room for `count` samples, (count, row length)."""
        return np.zeros((count, self.row_length))

    def advance(self, ticks: int) -> Samples:
        """Move by up to `ticks` sample periods; the samples of the instants reached, the present one not included.

        Fewer than `ticks` rows mean that the world stopped: `status` says why, and the state is the last good one.
        """
        return self.to_samples(self.advance_rows(ticks))

    def advance_rows(self, ticks: int) -> np.ndarray:
        """As `advance`, as rows (ticks done, row length) in the layout of `sim.row_layout`."""
        rows = self.new_rows(0 if self.status.failed else ticks)
        return rows[: self.fill(rows)]

    def run(self, ticks: int) -> Samples:
        """As `advance`, with the present instant as first sample."""
        rows = self.new_rows(1 if self.status.failed else ticks + 1)
        self._observe(rows[0])
        done = self.fill(rows[1:])
        return self.to_samples(rows[: done + 1])

    def fill(self, rows: np.ndarray) -> int:
        """Move by one tick per row of rows (ticks, row length), writing the samples there; returns the ticks done."""
        if self.status.failed:
            return 0
        before, estimate, done, code = self.state(), self._estimate, 0, 0
        while done < len(rows) and code == 0:
            part = rows[done : done + accuracy.ticks_to_check(self._estimate, self.tick)]
            start, looks = self.state(), accuracy.is_due(self._estimate, self.tick)
            ticks, code = self._advance(part, first_is_present=False)
            if code == INTERRUPTED:
                self._go_back(before, estimate)
                return 0
            if ticks == 0:
                continue
            seen, change, jump = accuracy.survey(self._estimate, self._assembly, part[:ticks])
            if jump >= 0 and not looks:  # It is to be looked at, and so are the ticks after it.
                self._go_back(start, accuracy.jumped(self._estimate, self.tick + jump))
                code = 0
                continue
            self.tick, done = self.tick + ticks, done + ticks
            self._estimate = accuracy.note_survey(self._estimate, seen, change if looks else 0.0)
            if looks:
                self._look(part[ticks - 1], start)
        if code != 0:
            velocities_at(self._assembly.system.plant, self._y, self._workspace)
            rate = self._workspace.velocity
            self.status = runtime_fault(self._assembly, code, self._y[:3], rate, self.time, self.tick_period)
        return done

    def _go_back(self, state: WorldState, estimate: accuracy.Estimate) -> None:
        """Stand again at an earlier state of this run, with what is known of its accuracy."""
        self.restore(state)
        self._estimate = estimate

    def _look(self, row: np.ndarray, start: WorldState) -> None:
        """Compare the tick from `start` on, whose sample is `row`, with the same tick redone with half the step."""
        assembly, tick, period = self._assembly, self.tick - 1, self.tick_period
        finer = accuracy.finer_level(self._estimate, assembly, tick, self._level)
        if finer is None:
            return
        again = accuracy.redo_tick(assembly, self._move or advance, finer, start, period, self.new_rows(1))
        if again is not None:
            self._estimate = accuracy.note(self._estimate, assembly, tick, row, self._y, again, period)

    def interrupt(self) -> None:
        """Make a `fill` that runs on another thread, or the next one, return with nothing done, within a step's time."""
        self._workspace.interrupt[0] = 1

    def _advance(self, rows: np.ndarray, first_is_present: bool) -> tuple[int, int]:
        """As `advance.advance`, from tick to tick with the step that each wants."""
        assembly, done = self._assembly, 0
        while True:
            here, limit = self.tick + done, DEFLECTION_LIMIT * self.scenario.payload.length
            kinked = None if first_is_present else next_tick_of_kinks(assembly, self._level, here, self.tick_period)
            if kinked is not None and kinked.number == here and done < len(rows):
                dt = self.tick_period / (assembly.step_count << self._level)
                code = advance_in_pieces(
                    assembly, self._move or advance, assembly.system, assembly.watch, self._level, dt, limit,
                    kinked.cuts, self._y, self._workspace, rows[done : done + 1],
                )  # fmt: skip
                if code == 0:
                    done += 1
                elif code >= OTHER_STEP:
                    self._level = code - OTHER_STEP
                else:
                    return done, code
                continue
            end = len(rows) if kinked is None else min(len(rows), done + kinked.number - here)
            arguments = (
                assembly.system,
                assembly.sampling._replace(steps=assembly.sampling.steps << self._level),
                *assembly.levels.scheme(self._level),
                assembly.watch,
                self._level,
                limit,
                0.0,
                here,
                self.tick_period,
                assembly.step_count << self._level,
                self._y,
                np.empty_like(self._y),
                self._workspace,
                rows[done:end],
                first_is_present,
            )
            if self._move is None:
                self._move = entry_point(advance, *arguments)
            ticks, code = self._move(*arguments)
            done += ticks
            if code >= OTHER_STEP:
                self._level = code - OTHER_STEP
            elif code != 0 or done >= len(rows) or first_is_present:
                return done, code

    def apply(self, command: WorldCommand, known: Sequence[Assembly] = (), at_once: bool = False) -> bool:
        """Carry out a command at the present instant; returns whether a new run begins.

        It does when the change cannot be taken on in motion (the world starts anew, at t = 0), when the beam's coordinates get
        another meaning (another mesh or boundary; time goes on), or when a law with other signals of its own takes over (time
        and motion go on). Raises `ScenarioError` (and changes nothing) for values
        that are not valid or a motion that cannot be reached. `known`: assemblies whose parts need no deriving where they fit;
        the result is the same without them. `at_once`: raise `Unprepared` (and change nothing) instead of deriving what takes
        long, see `build_assembly`.
        """
        assembly, payload = self._assembly, self.scenario.payload
        if isinstance(command, ChangeScenario):
            return self._change(command, known, at_once)
        if isinstance(command, Pull):
            apply_pull(assembly.system.plant, self.scenario, assembly.beam, command)
        else:
            apply_tap(payload, assembly.beam, self._y, command)
        self._estimate = accuracy.disturbed(self._estimate, assembly, self.tick)
        return False

    def _change(self, command: ChangeScenario, known: Sequence[Assembly], at_once: bool) -> bool:
        scenario = change_path(self.scenario, command.changes, self.time)
        fault = None if same_reach(self.scenario, scenario) else check_trajectory(scenario)
        if fault is not None:
            raise ScenarioError([("trajectory", fault.text)])
        known = [self._assembly, *known]
        if not _goes_on(self.scenario, scenario):
            anew = World(scenario.anew(), self.tick_period, known, at_once)
            if anew.status.failed:
                raise ScenarioError([("initial", anew.status.text)])
            vars(self).update(vars(anew))
            return True
        reshaped = not (_same_mesh(self.scenario, scenario) and own_signals(self.scenario) == own_signals(scenario))
        assembly = build_assembly(scenario, self.tick_period, known, at_once)
        if command.keeps_target:
            assembly = self._go_on_from_target(assembly)
        self._carry_over(assembly.scenario, assembly)
        return reshaped

    def _go_on_from_target(self, assembly: Assembly) -> Assembly:
        """The assembly with a target that goes on from where it is."""
        old = self._assembly.system.trajectory
        if equal_motions(old, assembly.system.trajectory):
            return assembly
        scenario, motion = go_on_from(self.scenario, old, assembly.scenario, assembly.system.trajectory, self.time)
        return assembly._replace(scenario=scenario, system=assembly.system._replace(trajectory=motion))

    def _carry_over(self, scenario: Scenario, assembly: Assembly) -> None:
        """Go on with a new assembly: coordinates and velocities stay, momenta follow."""
        old, plant = self._assembly, self._assembly.system.plant
        n = plant.modal.shape[1]
        velocities_at(plant, self._y, self._workspace)
        rate, eta_dot = self._workspace.velocity.copy(), self._workspace.eta_dot.copy()
        if old.levels.scheme(0).notes_rates and np.isfinite(noted_rates(self._y, n)[-1]):
            eta_dot = noted_rates(self._y, n).copy()  # the rates that the samples show
        q, q_dot = plant.V @ self._y[ETA : ETA + n], plant.V @ eta_dot
        if not _same_mesh(self.scenario, scenario):
            q = project_beam(self.scenario.payload, scenario.payload, assembly.beam.matrices.M_q, q)
            q_dot = project_beam(self.scenario.payload, scenario.payload, assembly.beam.matrices.M_q, q_dot)
        starts_sampling = assembly.system.control.sampled and not old.system.control.sampled
        law_before = self._outlook(False)
        held = self.observe().joint_torque[0] if starts_sampling else old.system.held_torque
        assembly.system.held_torque[:] = assembly.sampling.line[:] = held
        if not starts_sampling:
            length = min(len(assembly.sampling.line), len(old.sampling.line))
            assembly.sampling.line[-length:] = old.sampling.line[-length:]
        before, self.scenario, self._assembly, self._level = self.scenario, scenario, assembly, 0
        self._move, self._estimate = None, accuracy.disturbed(self._estimate, assembly, self.tick)
        if assembly.beam is not old.beam:
            assembly.system.plant.pull[:] = plant.pull
            set_pull_row(assembly.system.plant, scenario.payload, assembly.beam)
        another_law = not same_law(before, scenario)
        kept: tuple[str, ...] = ()
        if assembly.beam is not old.beam or another_law:
            y = np.zeros(state_length(assembly.system))
            y[:ETA] = self._y[:ETA]
            kept = carry_memory(before, old.system, self._y, scenario, assembly.system, y)
            self._y, self._workspace = y, new_workspace(assembly.system)
        self._workspace.desired_time[0] = np.nan
        # The same arithmetic even where only a gain changed: the first recordings were made with it.
        eta, eta_dot = _to_modes(assembly.beam, q), _to_modes(assembly.beam, q_dot)
        self._set_motion(self._y[:3].copy(), rate, eta, eta_dot)
        law_now = self._outlook(starts_sampling)
        if another_law:
            start_memory(scenario, assembly.system, law_now, self._y, kept)
        else:
            adjust_memory(scenario, assembly.system, law_before, law_now, self._y)
        if starts_sampling:
            self._act_at_start()

    def state(self) -> WorldState:
        """A copy of all that changes with time."""
        assembly = self._assembly
        return WorldState(
            self.tick,
            self._y.copy(),
            assembly.system.held_torque.copy(),
            assembly.sampling.line.copy(),
            assembly.system.plant.pull.copy(),
        )

    def restore(self, state: WorldState) -> None:
        """Go on from a `WorldState` of the same scenario. Raises `StudyError`, and changes nothing, for any other state."""
        own = self.state()
        for part in fields(WorldState):
            given, fitting = np.shape(getattr(state, part.name)), np.shape(getattr(own, part.name))
            if given != fitting:
                raise StudyError(
                    f"This state does not fit its scenario: {part.name} has the shape {given}, not {fitting}. "
                    "Take scenario and state from the same instant of one run."
                )
        self.tick = state.tick
        self._y = state.y.copy()
        self._assembly.system.held_torque[:] = state.held_torque
        self._assembly.sampling.line[:] = state.torque_line
        self._assembly.system.plant.pull[:] = state.pull
        set_pull_row(self._assembly.system.plant, self.scenario.payload, self._assembly.beam)
        self._workspace = new_workspace(self._assembly.system)
        self._estimate = accuracy.nothing_yet(self._assembly, self.tick)
        self.status = Status("running", "Running.")


def _to_modes(beam: Beam, q: np.ndarray) -> np.ndarray:
    """η = VᵀM_q q."""
    return beam.modes.V.T @ (beam.matrices.M_q @ q)


def same_motion(one: Scenario, other: Scenario) -> bool:
    """Whether a run that goes from one scenario to the other is one motion, and only a law's own signals may differ."""
    return _goes_on(one, other) and _same_mesh(one, other)


def _goes_on(one: Scenario, other: Scenario) -> bool:
    """Whether a run can go on from one scenario in the other: with another machine or another start it begins anew."""
    same_arms = (one.left_arm, one.right_arm) == (other.left_arm, other.right_arm)
    return same_arms and one.payload.length == other.payload.length and one.initial == other.initial


def _same_mesh(one: Scenario, other: Scenario) -> bool:
    """Whether beam coordinates mean the same in two scenarios."""
    a, b = one.payload, other.payload
    return (a.element_count, a.boundary) == (b.element_count, b.boundary)
