"""The settings of an environment, and its worlds, which move together on several threads."""

import weakref
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import ValidationError, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from flexlab.compiled import PLAIN_PYTHON, entry_point
from flexlab.errors import StudyError
from flexlab.gym_environment.kernels import OBSERVED, Variants, Worlds, begin_worlds, step_worlds
from flexlab.gym_environment.standing_threads import StandingThreads
from flexlab.machine import cores, free_memory
from flexlab.physics.law_input import MOST_DELAY
from flexlab.physics.plant import Workspace
from flexlab.presets import any_scenario
from flexlab.quantities import Count, CountPair, Number, Pair, Part, Triple, quantity
from flexlab.scenario import Scenario
from flexlab.scenario.validation_errors import close_paths, did_you_mean, problem
from flexlab.sim.assembly import Assembly
from flexlab.sim.closed_loop import new_workspace, state_length
from flexlab.sim.integrators.scheme import Etdrk4
from flexlab.sim.sampled_control import NEVER_ACTS, loop_variant
from flexlab.sim.samples import Samples, row_length, rows_to_samples
from flexlab.sim.step_trial import build_assembly
from flexlab.sim.target import desired_at
from flexlab.sim.termination import DEFLECTION_LIMIT, check_trajectory
from flexlab.text import number_text

WRENCH = "wrench"


@dataclass(frozen=True)
class Rules:
    """Scales of actions and rewards in a version of the environment."""

    wrench_scale: tuple[float, float, float]
    """Wrench of an action of 1, N, N, N·m."""
    rooted: bool
    """Whether the cost per second is √c instead of c."""
    worst: float
    """Largest cost per second, which is also the cost of each second left of a failed episode."""


RULES = {
    0: Rules((200.0, 200.0, 50.0), False, 100.0),
    # The paper's path takes 320 N. Quadratic costs are all at the limit beyond 0.1 m, where learning begins.
    1: Rules((600.0, 600.0, 150.0), True, 50.0),
}
"""Rules by version of the environment; released versions do not change."""


class Settings(Part):
    """Settings of an environment."""

    scenario: Any = "paper"
    """The scenario with arms, beam and path; its control law does not act."""
    action: Literal["wrench", "torques"] = WRENCH
    """"wrench" (3 numbers) or "torques" (3 per arm)."""
    control_period: Number = quantity(1e-3, "Time between two actions", unit="s", low=1e-4, high=0.02)
    duration: Number = quantity(2.0, "Length of an episode", unit="s", low=1e-4, high=1e4)
    stiffness: Pair | None = quantity(None, "Bending stiffness", unit="N·m²", low=1e-3, high=1e12)
    """Range of an episode's EI, with equal ratios equally likely; None for the scenario's."""
    delay: CountPair = quantity((0, 0), "Delay", unit="control periods", low=0, high=MOST_DELAY)
    """Range of the delay of an episode's actions, both ends included."""
    noise: Number = quantity(0.0, "Largest scale of the measuring noise", low=0.0, high=100.0)
    """Each episode has a random share of it; a scale of 1 is `NOISE`."""
    start_spread: Triple = quantity((0.005, 0.005, 0.01), "Spread", unit="m, m, rad", low=0.0, high=1.0)
    """Largest distance of an episode's start pose from the scenario's."""
    torque_limit: Number = quantity(200.0, "Torque limit of each joint", unit="N·m", low=1e-3, high=1e6)
    variants: Count = quantity(32, "Stiffnesses that represent the range", low=1, high=1024)
    """Each takes a few milliseconds when the environment is made."""
    threads: Count | None = quantity(None, "Threads that move the worlds", low=1, high=1024)
    """None for one per core. Few worlds use fewer."""
    version: Literal[0, 1] = 1
    """Version of the environment, which its name gives; see `RULES`."""

    @classmethod
    def of(cls, options: dict[str, Any]) -> "Settings":
        """The settings in keywords. Raises `StudyError` for unusable ones."""
        known = cls.model_fields
        for name in options:
            if name not in known:
                near = close_paths(name, known)
                hint = did_you_mean(near) if near else f"choose among {', '.join(known)}."
                raise StudyError(f"The environment has no option {name:.60}: {hint}")
        try:
            return cls(**options)
        except ValidationError as error:
            raise StudyError(problem(cls, error.errors(include_url=False)[0])[1]) from None

    @field_validator("stiffness", "delay")
    @classmethod
    def _rises(cls, value: Any) -> Any:
        if value is not None and value[0] > value[1]:
            raise PydanticCustomError("order", "it is not a range, so write the smaller limit first")
        return value

    @field_validator("duration")
    @classmethod
    def _holds_an_action(cls, value: float, info: ValidationInfo) -> float:
        if value < info.data.get("control_period", 0.0):
            raise PydanticCustomError("short", "it is shorter than a control period")
        return value

    @property
    def rules(self) -> Rules:
        """Scales of actions and rewards."""
        return RULES[self.version]

    @property
    def ticks(self) -> int:
        """Control periods of an episode."""
        return max(round(self.duration / self.control_period), 1)


NOISE = (1e-4, 1e-4, 1e-4, 1e-2, 1e-2, 1e-2, 1e-3, 1e-4)
"""Standard deviations of the measured e (m, m, rad), ė (m/s, m/s, rad/s), hᵀq̇ (kg·m/s) and gᵀq̇ (kg·m²/s) at scale 1."""
ACCURACY = 1e-7
"""Accuracy of the integration step, m: the paper's beam then takes one step per millisecond."""
LEAST_PER_THREAD = 16
"""Smallest number of worlds for which another thread pays."""


class WorldBatch:
    """`count` worlds; see `Settings`. Raises `StudyError` or `ScenarioError`."""

    def __init__(self, settings: Settings, count: int):
        self.settings, self.count = settings, count
        base = _base(settings)
        self.scenario, self.arm_count = base, len(base.arms)
        given = settings.stiffness
        stiffness = np.geomspace(*given, settings.variants) if given else np.array([base.payload.bending_stiffness])
        assemblies: list[Assembly] = []
        for value in stiffness:
            scenario = base.replace({"payload.bending_stiffness": float(value)})
            assemblies.append(build_assembly(scenario, settings.control_period, assemblies[-1:]))
        first = assemblies[0]
        self.stiffness = stiffness
        self._system, self._watch = first.system, first.watch._replace(most=0)
        self._sampling = first.sampling._replace(steps=NEVER_ACTS)
        self._variants = _stack(assemblies)
        self._bend_limit = DEFLECTION_LIMIT * base.payload.length
        self._desired = desired_at(first.system.trajectory, 0.0)
        pairs = zip((base.initial.pose, base.initial.pose_rate), self._desired, strict=False)
        self._start = np.array([path if own is None else own for own, path in pairs])
        self._limits, self._noise = np.full(3, float(settings.torque_limit)), np.array(NOISE)
        _check_room(count, sum(array.nbytes for array in _new_worlds(1, first, settings)))
        self.state, self._begun = _new_worlds(count, first, settings), np.zeros(count, bool)
        threads = max(1, min(int(settings.threads or cores()), count // LEAST_PER_THREAD))
        edges = np.linspace(0, count, threads + 1).astype(int)
        self._parts = [
            (slice(low, high), Worlds(*(array[low:high] for array in self.state)), new_workspace(first.system))
            for low, high in zip(edges[:-1], edges[1:], strict=True)
        ]
        self._actions = np.zeros((count, self.action_size))
        parts = [self._arguments(*part) for part in self._parts]
        kernel = entry_point(step_worlds, *parts[0])
        self._move = self._move_alone = lambda: [kernel(*part) for part in parts]
        self._end_threads = lambda: None
        if threads > 1 and not PLAIN_PYTHON:
            standing = StandingThreads(step_worlds, parts, loop_variant(first.system.plant))
            self._move, self._end_threads = standing.run, weakref.finalize(self, standing.close)

    def __reduce__(self) -> tuple[Any, ...]:
        """How the worlds are copied, and passed to other processes: with arrays and threads of their own."""
        return _restored, (self.settings, self.count, [*self.state, self._begun])

    @property
    def action_size(self) -> int:
        """Number of values in an action."""
        return 3 if self.settings.action == WRENCH else 3 * self.arm_count

    def begin(self, chosen: np.ndarray, random: np.random.Generator) -> None:
        """Begin new episodes in the worlds of `chosen` (count,), with stiffness, delay and noise drawn anew."""
        state, settings, number = self.state, self.settings, int(chosen.sum())
        self._begun |= chosen
        state.pause[:] = chosen
        state.variant[chosen] = random.integers(len(self.stiffness), size=number)
        state.delay[chosen] = random.integers(settings.delay[0], settings.delay[1] + 1, size=number)
        state.seed[chosen] = random.integers(2**31, size=number)
        state.noise[chosen] = settings.noise * random.random(number)
        state.offset[chosen] = random.uniform(-1, 1, (number, 3)) * np.array(settings.start_spread)
        begin_worlds(self._system.plant, self._variants, state, self._start, self._desired, self._parts[0][2])

    def step(self, actions: np.ndarray) -> None:
        """Move the worlds that do not pause under actions (count, action_size), on all threads; then end all pauses.

        Raises `StudyError` if a world has no episode.
        """
        if not self._begun.all():
            raise StudyError("A world has no episode yet: call reset before step.")
        self._actions[:] = actions
        self._move()
        self.state.pause[:] = False

    def _arguments(self, place: slice, worlds: Worlds, ws: Workspace) -> tuple[Any, ...]:
        settings = self.settings
        return (
            self._system, self._sampling, self._watch, self._variants, worlds, self._actions[place], settings.action == WRENCH,
            self._limits, self._noise, settings.control_period, settings.ticks, self._bend_limit, settings.rules.worst,
            settings.rules.rooted, 0, False, ws,
        )  # fmt: skip

    def samples(self) -> Samples:
        """Samples by which the worlds are drawn, (count,)."""
        return rows_to_samples(self.state.row[:, 0], self.arm_count)

    def close(self) -> None:
        """End the threads."""
        self._move = self._move_alone
        self._end_threads()


def _restored(settings: Settings, count: int, arrays: list[np.ndarray]) -> WorldBatch:
    made = WorldBatch(settings, count)
    for array, value in zip((*made.state, made._begun), arrays, strict=True):
        array[:] = value
    return made


def _base(settings: Settings) -> Scenario:
    """The scenario without a control law. Raises `StudyError` if the environment cannot simulate it."""
    scenario = any_scenario(settings.scenario)
    if scenario.joints.encoders.active:
        raise StudyError(
            "joints.encoders cannot be used in the environment, which measures exact poses with its own noise: "
            "choose a scenario whose joints.encoders.counts are 0."
        )
    if scenario.payload.mass_change.active:
        raise StudyError(
            f"payload.mass_change.factor = {scenario.payload.mass_change.factor:g} cannot be used in the environment, whose "
            "integrator needs a constant mass: choose a scenario whose factor is 1."
        )
    if scenario.grips.active:
        raise StudyError(
            "grips.model = compliant cannot be used in the environment, whose integrator needs rigid grips: "
            "choose a scenario whose grips.model is rigid."
        )
    changes = {"controller.kind": "none", "controller.control_period": settings.control_period}
    scenario = scenario.anew().replace({"controller.kind": "none"}).replace(changes)
    accuracy = max(ACCURACY, scenario.simulation.accuracy)
    scenario = scenario.replace({"simulation.integrator": "etdrk4", "simulation.accuracy": accuracy})
    fault = check_trajectory(scenario)
    if fault is not None:
        raise StudyError(fault.text)
    return scenario


def _stack(assemblies: list[Assembly]) -> Variants:
    schemes = [assembly.levels.scheme(0).etdrk4 for assembly in assemblies]
    plants = [assembly.system.plant for assembly in assemblies]
    of_plants = {name: [getattr(plant, name) for plant in plants] for name in Variants._fields[:7]}
    return Variants(
        **{name: None if values[0] is None else np.stack(values) for name, values in of_plants.items()},
        etdrk4=Etdrk4(*map(np.stack, zip(*(scheme for scheme in schemes if scheme is not None), strict=True))),
        step_count=np.array([assembly.step_count for assembly in assemblies]),
    )


def _check_room(count: int, size: int) -> None:
    """Raise `StudyError` if `count` worlds of `size` bytes do not fit into the memory: the system would end the process later."""
    free = free_memory()
    if free is not None and count * size > free:
        raise StudyError(
            f"num_envs = {count} worlds take {number_text(count * size / 1e9)} GB, and {number_text(free / 1e9)} GB of memory "
            f"are free: give {int(free / size)} or fewer."
        )


def _new_worlds(count: int, assembly: Assembly, settings: Settings) -> Worlds:
    arms, length = len(assembly.scenario.arms), state_length(assembly.system)
    row = row_length(arms, assembly.beam.modes.V.shape[0])
    return Worlds(
        variant=np.zeros(count, int), y=np.zeros((count, length)), good=np.zeros((count, length)),
        held=np.zeros((count, arms, 3)), line=np.zeros((count, settings.delay[1] + 1, arms, 3)),
        delay=np.zeros(count, int), tick=np.zeros(count, int), seed=np.zeros(count, int), noise=np.zeros(count),
        offset=np.zeros((count, 3)), pause=np.ones(count, bool), row=np.zeros((count, 1, row)),
        observation=np.zeros((count, OBSERVED), np.float32), reward=np.zeros(count), failed=np.zeros(count, bool),
        over=np.zeros(count, bool),
    )  # fmt: skip
