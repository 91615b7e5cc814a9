"""The simulated world: deterministic stepping, no clock, no thread.

Same scenario and same commands at the same ticks give the same bits, whatever the sizes of the blocks it is advanced by.
"""

import math
from collections.abc import Sequence
from typing import NoReturn

import numpy as np

from flexlab.control.law import laws
from flexlab.errors import StudyError
from flexlab.physics.mass_change import find_mass_at
from flexlab.physics.plant import ETA
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim import accuracy, samples
from flexlab.sim.assembly import Assembly
from flexlab.sim.build import Beam
from flexlab.sim.bumpless_transfer import change_in_motion
from flexlab.sim.closed_loop import System, scratch_workspace
from flexlab.sim.commands import ChangeScenario, Pull, WorldCommand
from flexlab.sim.disturbance import apply_axial_impulse, apply_pull, apply_tap
from flexlab.sim.integrators.beam_flow import TICKS
from flexlab.sim.motion import begin_motion, restore, state_of
from flexlab.sim.run_warnings import ModelWarning, model_warning, pace_warning
from flexlab.sim.samples import Samples, Status, WorldState
from flexlab.sim.signals import own_signals
from flexlab.sim.snapshot import TICK
from flexlab.sim.step_levels import DISTURBED_TICKS
from flexlab.sim.step_size import other_integrators
from flexlab.sim.step_trial import build_assembly
from flexlab.sim.stepping import fill, observe


class World:
    """One scenario in motion. `advance` moves it, `apply` changes it; a change that is refused leaves it as it was."""

    def __init__(
        self, scenario: Scenario, tick_period: float = TICK, known: Sequence[Assembly] = (), at_once: bool = False
    ):
        """Build and check; raises `ScenarioError` if the scenario is not valid.

        An unreachable trajectory or start pose raises nothing: `status` has failed then. `known` and `at_once` as for `apply`.
        """
        self._motion = begin_motion(build_assembly(parse_scenario(scenario.model_dump()), tick_period, known, at_once))

    def __reduce__(self) -> NoReturn:
        """Refuse copies and pickles: they would share memory with this world, or hold addresses of its process."""
        raise StudyError("A world cannot be copied or pickled: build one of the same scenario, and restore its state.")

    @property
    def scenario(self) -> Scenario:
        """The scenario in motion."""
        return self._motion.scenario

    @property
    def status(self) -> Status:
        """Whether it runs, or why it has stopped."""
        return self._motion.status

    @property
    def tick_period(self) -> float:
        """Time between two samples, s."""
        return self._motion.tick_period

    @property
    def tick(self) -> int:
        """Number of the present instant."""
        return self._motion.tick

    @property
    def time(self) -> float:
        """Simulation time, s: exactly tick · tick_period."""
        return self._motion.time

    @property
    def step(self) -> float:
        """The integration step in use, s."""
        return self.assembly.levels.step / 2**self._motion.level

    @property
    def accuracy_warning(self) -> str:
        """Why results are no longer accurate, and since when, or why they cannot be repeated; empty while all is well."""
        law = self.scenario.controller
        estimate = self._motion.estimate
        return laws()[law.kind].warning(law) or " ".join(filter(None, (estimate.warning, estimate.loss.warning)))

    @property
    def model_warning(self) -> ModelWarning:
        """The warning for an axial force, a spin or a deflection beyond the validity of the beam's model."""
        return model_warning(self.scenario.payload, self._motion.estimate.peaks)

    @property
    def warnings(self) -> str:
        """All warnings about the accuracy and validity of the results so far, as sentences; empty if there are none."""
        return " ".join(filter(None, (*self._motion.estimate.ended, self.accuracy_warning, self.model_warning.text)))

    @property
    def pace_warning(self) -> str:
        """A sentence on what is estimated to make the run slower than real time, and what to change; empty if it is not."""
        assembly = self.assembly
        n, watch = len(assembly.beam.modes.omega), assembly.watch
        settled = watch.disturbed == 0 or not self._motion.y[ETA + 2 * n + TICKS] < DISTURBED_TICKS * watch.disturbed
        growing = self._motion.level > 0 and settled
        bound = "law" if growing else assembly.bound
        level = self._motion.level if growing else 0
        others = other_integrators(self.scenario)
        return pace_warning(assembly, assembly.levels.step / 2**level, bound, others)

    @property
    def integrator(self) -> str:
        """The integrator in use."""
        return self.assembly.levels.integrator

    @property
    def beam(self) -> Beam:
        """Matrices and modes of the payload."""
        return self.assembly.beam

    @property
    def system(self) -> System:
        """The kernels' constants, for studies of the same world (do not change them)."""
        return self.assembly.system

    @property
    def assembly(self) -> Assembly:
        """All that is derived from the scenario, for worlds to come (do not change it)."""
        return self._motion.assembly

    @property
    def first_frequency(self) -> float:
        """f1 of the payload with its grips held and its present mass, Hz."""
        plant, omega = self.system.plant, float(np.min(self.beam.modes.omega))
        if plant.mass_change is not None:
            omega /= math.sqrt(find_mass_at(plant, self.time, scratch_workspace(self.system)))
        return omega / (2 * np.pi)

    @property
    def row_length(self) -> int:
        """Columns of a sample row; they depend on arms, mesh and the law's own signals only."""
        return self._motion.row_length

    def new_rows(self, count: int) -> np.ndarray:
        """Room for `count` samples, (count, row length)."""
        return np.zeros((count, self.row_length))

    def to_samples(self, rows: np.ndarray) -> Samples:
        """Views of the signals in rows (N, row length) of this world."""
        return samples.rows_to_samples(rows, len(self.scenario.arms), own_signals(self.scenario))

    def observe(self) -> Samples:
        """The sample of the present instant (N = 1); after a failed start, the pose alone, the rest zero."""
        return self.to_samples(self.observe_rows())

    def observe_rows(self) -> np.ndarray:
        """As `observe`, as a row (1, row length) in the layout of `sim.samples`."""
        rows = self.new_rows(1)
        observe(self._motion, rows[0])
        return rows

    def advance(self, ticks: int) -> Samples:
        """Move by up to `ticks` sample periods; returns the samples of the instants reached, without the present one.

        Fewer than `ticks` rows mean that the world stopped: `status` says why, and the state is the last good one.
        """
        return self.to_samples(self.advance_rows(ticks))

    def advance_rows(self, ticks: int) -> np.ndarray:
        """As `advance`, as rows (ticks done, row length) in the layout of `sim.samples`."""
        rows = self.new_rows(0 if self.status.failed else ticks)
        return rows[: self.fill(rows)]

    def run(self, ticks: int) -> Samples:
        """As `advance`, with the present instant as first sample."""
        rows = self.new_rows(1 if self.status.failed else ticks + 1)
        observe(self._motion, rows[0])
        done = self.fill(rows[1:])
        return self.to_samples(rows[: done + 1])

    def fill(self, rows: np.ndarray) -> int:
        """Move by one tick per row of rows (ticks, row length), writing the samples there; returns the ticks done."""
        return fill(self._motion, rows)

    def interrupt(self) -> None:
        """Make a `fill` that runs on another thread, or the next one, return with nothing done, within a step's time."""
        self._motion.workspace.interrupt[0] = 1

    def apply(self, command: WorldCommand, known: Sequence[Assembly] = (), at_once: bool = False) -> bool:
        """Carry out a command at the present instant; returns whether a new run begins.

        It does if the change is impossible in motion (the world starts anew at t = 0), if the beam's coordinates change their
        meaning (another mesh or boundary; time goes on), or if a law with other signals of its own takes over (time and motion
        go on). Raises `ScenarioError` (and changes nothing) for values that are not valid or a motion that cannot be reached.
        `known`: assemblies whose parts are shared where they fit; the result is the same without them. `at_once`: raise
        `Unprepared` (and change nothing) instead of deriving what takes long, see `build_assembly`.
        """
        motion, assembly = self._motion, self.assembly
        if isinstance(command, ChangeScenario):
            self._motion, begins_anew = change_in_motion(motion, command, known, at_once)
            return begins_anew
        if isinstance(command, Pull):
            apply_pull(assembly.system.plant, motion.scenario, assembly.beam, command)
        else:
            plant, before = assembly.system.plant, motion.y.copy()
            factor = find_mass_at(plant, motion.time, motion.workspace)
            apply_tap(motion.scenario.payload, assembly.beam, motion.y, command, factor)
            apply_axial_impulse(
                plant, motion.scenario.payload, assembly.beam, before, motion.y, motion.workspace, command, factor
            )
        motion.estimate = accuracy.disturbed(motion.estimate, assembly, motion.tick)
        return False

    def state(self) -> WorldState:
        """A copy of all that changes with time."""
        return state_of(self._motion)

    def restore(self, state: WorldState) -> None:
        """Go on from a `WorldState` of the same scenario. Raises `StudyError`, and changes nothing, for any other state."""
        restore(self._motion, state)
