"""Settings of an environment, and its worlds, which move together on several threads."""

import difflib
import numbers
import os
import weakref
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from flexlab.compiled import PLAIN_PYTHON, entry_point
from flexlab.errors import StudyError
from flexlab.gym_environment.kernels import OBSERVED, Variants, Worlds, begin_worlds, step_worlds
from flexlab.gym_environment.standing_threads import StandingThreads
from flexlab.physics.law_input import MOST_DELAY
from flexlab.physics.plant import Workspace
from flexlab.presets import AnyScenario, any_scenario
from flexlab.scenario import Scenario
from flexlab.sim.assembly import Assembly
from flexlab.sim.closed_loop import new_workspace, state_length
from flexlab.sim.integrators.scheme import Etdrk4
from flexlab.sim.sampled_control import loop_variant
from flexlab.sim.samples import Samples, row_length, rows_to_samples
from flexlab.sim.signals import MIDSPAN
from flexlab.sim.step_trial import build_assembly
from flexlab.sim.target import desired_at
from flexlab.sim.termination import DEFLECTION_LIMIT, check_trajectory

WRENCH, TORQUES = "wrench", "torques"
LARGEST_NOISE = 1.0
MOST_VARIANTS = 1024
MOST_THREADS = 1024
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-4, 0.02
"""s of a control period."""


@dataclass(frozen=True)
class Rules:
    """Scales of actions and rewards in a version of the environment."""

    wrench_scale: tuple[float, float, float]
    """N, N, N·m of a wrench of 1."""
    rooted: bool
    """Whether a second costs √c rather than c, see `environment`."""
    worst: float
    """Largest cost of a second, which each second left of a failed episode costs too."""


RULES = {
    0: Rules((200.0, 200.0, 50.0), False, 100.0),
    # The paper's path takes 320 N. Costs that grow with the square are all the worst beyond 0.1 m, where learning begins.
    1: Rules((600.0, 600.0, 150.0), True, 50.0),
}
"""By version of the environment; released versions do not change."""


@dataclass(frozen=True)
class Settings:
    """Settings of an environment. Raises `StudyError` for values that are not usable."""

    scenario: AnyScenario = "paper"
    """Gives arms, beam and path; its control law does not act."""
    action: str = WRENCH
    """"wrench" (3 numbers) or "torques" (3 per arm), see `environment`."""
    control_period: float = 1e-3
    """s between two actions."""
    duration: float = 2.0
    """s of an episode."""
    stiffness: tuple[float, float] | None = None
    """EI of an episode, N·m²: from a range, equal ratios equally likely; None: the scenario's."""
    delay: tuple[int, int] = (0, 0)
    """Control periods by which an episode's actions arrive late: from a range, both ends included."""
    noise: float = 0.0
    """Largest scale of the measuring noise, of which an episode has a random share: 1 is `environment.NOISE`."""
    start_spread: tuple[float, float, float] = (0.005, 0.005, 0.01)
    """Largest distance of an episode's start pose from the scenario's, m, m, rad."""
    torque_limit: float = 200.0
    """N·m of each joint."""
    variants: int = 32
    """Stiffnesses that represent the range; each takes some milliseconds when the environment is made."""
    threads: int | None = None
    """Threads that move the worlds; None: one per core. Few worlds use fewer."""
    version: int = max(RULES)
    """Of the environment, see `RULES`; its name says it."""

    @classmethod
    def of(cls, options: dict[str, Any]) -> "Settings":
        """From keywords. Raises `StudyError` for one that is not known."""
        known = [each.name for each in fields(cls)]
        for name in options:
            if name not in known:
                near = difflib.get_close_matches(name, known, n=1)
                hint = f"did you mean {near[0]}?" if near else f"choose among {', '.join(known)}."
                raise StudyError(f"The environment has no option {name:.60}: {hint}")
        return cls(**options)

    def __post_init__(self) -> None:
        if not isinstance(self.action, str) or self.action not in (WRENCH, TORQUES):
            raise StudyError(f"action = {self.action!r:.60} is not known: choose {WRENCH} or {TORQUES}.")
        self._check("control_period", self.control_period, SHORTEST_PERIOD, LONGEST_PERIOD, "s")
        self._check("duration", self.duration, self.control_period, 1e4, "s")
        self._check("noise", self.noise, 0.0, LARGEST_NOISE * 100, "times NOISE")
        self._check("torque_limit", self.torque_limit, 1e-3, 1e6, "N·m")
        if type(self.version) is not int or self.version not in RULES:
            raise StudyError(f"version = {self.version!r:.60} is not known: choose {' or '.join(map(str, RULES))}.")
        for name, count in (("stiffness", 2), ("delay", 2), ("start_spread", 3)):
            value = getattr(self, name)
            if not (name == "stiffness" and value is None) and np.shape(value) != (count,):
                need = "the smaller limit first, (low, high)" if count == 2 else "three numbers, (x, y, θ)"
                raise StudyError(f"{name} = {value!r:.60} is not usable: write {need}.")
        for spread in self.start_spread:
            self._check("start_spread", spread, 0.0, 1.0, "m, m, rad")
        for number in self.delay:
            self._check("delay", number, 0, MOST_DELAY, "control periods", numbers.Integral)
        self._check("variants", self.variants, 1, MOST_VARIANTS, "stiffnesses", numbers.Integral)
        if self.threads is not None:
            self._check("threads", self.threads, 1, MOST_THREADS, "threads", numbers.Integral)
        if self.stiffness is not None:
            for value in self.stiffness:
                self._check("stiffness", value, 1e-3, 1e12, "N·m²")
        for name in ("stiffness", "delay"):
            pair = getattr(self, name)
            if pair is not None and pair[0] > pair[1]:
                raise StudyError(f"{name} = {pair!r:.60} is no range: write the smaller limit first, (low, high).")

    def _check(self, name: str, value: Any, low: float, high: float, unit: str, kind: Any = numbers.Real) -> None:
        if isinstance(value, bool) or not isinstance(value, kind) or not low <= value <= high:
            what = "whole number" if kind is numbers.Integral else "number"
            raise StudyError(f"{name} = {value!r:.60} is not usable: give a {what} from {low:g} to {high:g} {unit}.")

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
"""m that the step aims at: the paper's beam then takes one step per millisecond."""
NEVER = 2**62
"""Steps until the law of the scenario acts."""
LEAST_PER_THREAD = 16
"""Worlds for which handing work to another thread pays."""


class WorldBatch:
    """`count` worlds; see `Settings`. Raises `StudyError` or `ScenarioError`."""

    def __init__(self, settings: Settings, count: int):
        self.settings, self.count = settings, count
        base = _base(settings)
        self.scenario, self.arm_count = base, len(base.arms)
        stiffness = _stiffnesses(settings, base)
        assemblies: list[Assembly] = []
        for value in stiffness:
            scenario = base.replace({"payload.bending_stiffness": float(value)})
            assemblies.append(build_assembly(scenario, settings.control_period, assemblies[-1:]))
        first = assemblies[0]
        self.stiffness = stiffness
        self._system, self._watch = first.system, first.watch._replace(most=0)
        self._sampling = first.sampling._replace(steps=NEVER)
        self._variants = _stack(assemblies)
        self._bend_limit = DEFLECTION_LIMIT * base.payload.length
        self._desired = desired_at(first.system.trajectory, 0.0)
        given = base.initial.pose, base.initial.pose_rate
        self._start = np.array(
            [own if own is not None else path for own, path in zip(given, self._desired, strict=False)]
        )
        self._limits, self._noise = np.full(3, float(settings.torque_limit)), np.array(NOISE)
        self.state, self._begun = _new_worlds(count, first, settings), np.zeros(count, bool)
        threads = max(1, min(int(settings.threads or os.cpu_count() or 1), count // LEAST_PER_THREAD))
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

    @property
    def action_size(self) -> int:
        """Numbers of an action."""
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
        """Move the worlds that do not pause under actions (count, numbers), on all threads; then none pauses.

        Raises `StudyError` where a world has no episode.
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
        """What is drawn of the worlds, (count,)."""
        return rows_to_samples(self.state.row[:, 0], self.arm_count)

    def deflections(self) -> np.ndarray:
        """At mid-span, m, (count,)."""
        return self.state.row[:, 0, MIDSPAN].copy()

    def close(self) -> None:
        """End the threads."""
        self._move = self._move_alone
        self._end_threads()


def _base(settings: Settings) -> Scenario:
    """The scenario without a control law. Raises `StudyError` if the environment cannot simulate it."""
    scenario = any_scenario(settings.scenario)
    if scenario.joints.encoders.active:
        raise StudyError(
            "joints.encoders are not in the environment, which tells exact poses with its own noise: "
            "choose a scenario whose joints.encoders.counts are 0."
        )
    if scenario.payload.mass_change.active:
        raise StudyError(
            f"payload.mass_change.factor = {scenario.payload.mass_change.factor:g} is not in the environment, whose integrator "
            "needs a mass that stays: choose a scenario whose factor is 1."
        )
    if scenario.grips.active:
        raise StudyError(
            "grips.model = compliant is not in the environment, whose integrator needs rigid grips: "
            "choose a scenario whose grips.model is rigid."
        )
    changes = {"controller.kind": "none", "controller.control_period": settings.control_period}
    scenario = scenario.anew().replace({"controller.kind": "none"}).replace(changes)
    scenario = scenario.replace(
        {"simulation.integrator": "etdrk4", "simulation.accuracy": max(ACCURACY, scenario.simulation.accuracy)}
    )
    fault = check_trajectory(scenario)
    if fault is not None:
        raise StudyError(fault.text)
    return scenario


def _stiffnesses(settings: Settings, base: Scenario) -> np.ndarray:
    if settings.stiffness is None:
        return np.array([base.payload.bending_stiffness])
    return np.geomspace(*settings.stiffness, settings.variants)


def _stack(assemblies: list[Assembly]) -> Variants:
    schemes = [assembly.levels.scheme(0).etdrk4 for assembly in assemblies]
    plants = [assembly.system.plant for assembly in assemblies]
    return Variants(
        *(np.stack([getattr(plant, name) for plant in plants]) for name in Variants._fields[:7]),
        etdrk4=Etdrk4(*map(np.stack, zip(*(scheme for scheme in schemes if scheme is not None), strict=True))),
        step_count=np.array([assembly.step_count for assembly in assemblies]),
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
