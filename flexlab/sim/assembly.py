"""Everything that is derived from a scenario and then only used: kernel constants, integrator, sampling.

Each part is a pure function of a part of the scenario, so that parts of earlier assemblies can be shared: changing a gain costs
no more than the gain, and live, headless and replayed runs have the same bits whatever they share.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from flexlab.compiled import has_address
from flexlab.control.law import law_of, laws, nothing_derived
from flexlab.control.path import paths
from flexlab.numerics.linear_algebra import product
from flexlab.physics.sensors import gauge_places, load_moments, strain_rows
from flexlab.scenario import Scenario
from flexlab.sim.advance import advance
from flexlab.sim.build import Beam, build_beam, build_control, build_plant, extended
from flexlab.sim.closed_loop import System, new_workspace, state_length
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.parametric_resonance import may_resonate, steadiest
from flexlab.sim.sampled_control import LoopVariant, Sampling, control_instant, loop_variant, variant_of, with_kernel
from flexlab.sim.samples import check_signal_names
from flexlab.sim.step_levels import StepLevels, StepWatch
from flexlab.sim.step_rates import Rates, find_rates, instability
from flexlab.sim.step_size import Count, choose_step, steps_per_tick
from flexlab.sim.target import build_system, build_trajectory, same_target, with_transition

LIGHT_ELEMENTS = 8
"""Largest number of elements whose modes and matrix functions are derived in a millisecond or two."""
FORCED = 0.4
"""Ratio of the step taken to the step chosen below which the sample and control periods are said to bound it: dividing a tick
into whole steps alone leaves more than half."""
MUCH_SHORTER = 1.25
"""Ratio of the step asked for to the step taken above which parametric resonance is said to bound the step."""
AMPLIFYING = 1.5
"""`Assembly.instability` above which differences in the last digit become visible: of 60 random loops, those above it diverge or
depend on rounding, and none below it does."""


class Unprepared(Exception):
    """Raised if a world is to change at once but the derivation for `scenario` takes long."""

    def __init__(self, scenario: Scenario):
        super().__init__("to be derived beside the running world")
        self.scenario = scenario


class Assembly(NamedTuple):
    """What is derived from a scenario and a tick period."""

    scenario: Scenario
    tick_period: float
    """s."""
    beam: Beam
    system: System
    rates: Rates
    sampling: Sampling
    levels: StepLevels
    watch: StepWatch
    steps: Count
    """Steps at level 0."""
    asked: Count
    """Steps at level 0 before they were made shorter to avoid parametric resonance."""
    bound: str
    """What bounds the step, as `step_size.Choice.bound`, or "accuracy" (`step_trial`)."""
    instability: float = 0.0
    """As `step_rates.instability`: beyond 1 a sampled loop is unstable."""
    unrefined: "Assembly | None" = None
    """The assembly before its step was halved to make the run's beginning accurate; None if it was not halved."""

    @property
    def step_count(self) -> int:
        """Integration steps per tick at level 0."""
        return self.steps.per_tick

    @property
    def amplifies(self) -> bool:
        """Whether a sampled loop amplifies errors so much that results depend on rounding."""
        return self.instability > AMPLIFYING


def derive_assembly(
    scenario: Scenario, tick_period: float, known: Sequence[Assembly] = (), at_once: bool = False
) -> Assembly:
    """Derive everything from a scenario without a trial of its step; raises `ScenarioError`.

    `known` and `at_once` as for `step_trial.build_assembly`.
    """
    check_signal_names(scenario)
    law = scenario.controller
    if at_once and not (laws()[law.kind].is_ready(law) and knows_kernels(scenario)):
        raise Unprepared(scenario)
    known = [old.unrefined or old for old in known]
    same_beam = [old for old in known if old.scenario.payload == scenario.payload]
    must_wait, at_once = at_once, at_once and scenario.payload.element_count > LIGHT_ELEMENTS
    if at_once and not same_beam:
        raise Unprepared(scenario)
    beam = same_beam[0].beam if same_beam else build_beam(scenario.payload)
    system, rates = _close_loop(scenario, beam, next(iter(same_beam or known), None))
    integrator, step, bound = choose_step(scenario, system, beam, rates)
    asked = steps = steps_per_tick(scenario, tick_period, step)
    if integrator == "etdrk4" and bound != "given" and may_resonate(beam, rates, asked.step):
        alike = [old.steps for old in same_beam if _grows_alike(old, scenario, asked)]
        if at_once and not alike:
            raise Unprepared(scenario)
        middle, counted = np.array(scenario.trajectory.middle), partial(steps_per_tick, scenario, tick_period)
        steps = alike[0] if alike else steadiest(system, beam, rates, middle, asked, counted)
        if steps.step < asked.step / MUCH_SHORTER:
            bound = "resonance"
    dt = steps.step
    if asked.step < FORCED * step and asked.per_tick > 1:
        bound = "period"
    fitting = [old.levels for old in same_beam if (old.levels.integrator, old.levels.step) == (integrator, dt)]
    if (at_once and not fitting) or (must_wait and (integrator, loop_variant(system.plant)) not in _loaded):
        raise Unprepared(scenario)
    levels = fitting[0] if fitting else StepLevels(integrator, beam, dt)
    watch = levels.watch(scenario.simulation.step is not None, scenario.simulation.accuracy)
    for level in range(watch.disturbed + 3):  # and the quarter step of `accuracy`
        levels.scheme(level)
    sampling = _build_sampling(scenario, beam, steps.per_control)
    if system.control.sampled:
        sampling = with_kernel(sampling, system)
    if (integrator, loop_variant(system.plant)) not in _loaded:
        load_loop(system, sampling, levels.scheme(0), watch, tick_period, steps.per_tick)
        _loaded.add((integrator, loop_variant(system.plant)))
    unstable = instability(system, rates.poses, sampling.period, sampling.delay)
    return Assembly(scenario, tick_period, beam, system, rates, sampling, levels, watch, steps, asked, bound, unstable)


def with_transition_of(scenario: Scenario, assembly: Assembly) -> Assembly:
    """The assembly of a scenario that differs from its own in the path's transition only."""
    if scenario is assembly.scenario:
        return assembly
    path = with_transition(assembly.system.trajectory, scenario.trajectory.transition)
    return assembly._replace(scenario=scenario, system=assembly.system._replace(trajectory=path))


def _grows_alike(old: Assembly, scenario: Scenario, asked: Count) -> bool:
    """Whether an assembly with the same beam was tested for parametric resonance under equal conditions."""
    before = old.scenario
    return (
        old.asked == asked
        and old.levels.integrator == "etdrk4"
        and before.simulation == scenario.simulation  # Given steps were not tested.
        and before.trajectory.middle == scenario.trajectory.middle
        and before.controller.control_period == scenario.controller.control_period
        and before.arms == scenario.arms
    )


_loaded: set[tuple[str, LoopVariant]] = set()
"""Integrators whose loop is in memory, each with its `loop_variant`."""


def knows_kernels(scenario: Scenario) -> bool:
    """Whether the kernels of the scenario's law, path, plant and, if needed, sampled control are compiled or loaded."""
    parts = law_of(scenario.controller), paths()[scenario.trajectory.kind]
    variant = variant_of(scenario)
    if variant != LoopVariant() and all(loaded != variant for _, loaded in _loaded):
        return False
    return all(part.is_loaded for part in parts) and (
        scenario.controller.control_period is None or has_address(control_instant, variant)
    )


def load_loop(
    system: System, sampling: Sampling, scheme: Scheme, watch: StepWatch, tick_period: float, step_count: int
) -> None:
    """Compile the loop with an integrator, or load it, by a call that advances no tick."""
    y = np.zeros(state_length(system))
    rows, ws = np.zeros((0, 1)), new_workspace(system)
    advance(system, sampling, *scheme, watch, 0, np.inf, 0.0, 0, tick_period, step_count, y, y.copy(), ws, rows, False)


def _close_loop(scenario: Scenario, beam: Beam, old: Assembly | None) -> tuple[System, Rates]:
    """Build plant, law and path, sharing parts of a known assembly; motors are off until a sampled controller first acts."""
    if old is None:
        system = build_system(scenario, beam)
        return system, find_rates(beam, system, scenario.trajectory)
    before, plant, control = old.scenario, None, None
    trajectory = old.system.trajectory if same_target(before, scenario) else None
    same_arms = before.arms == scenario.arms and before.payload.length == scenario.payload.length
    same_plant = same_arms and old.beam is beam
    if same_plant:
        if before.controller == scenario.controller and _same_constants(before, scenario):
            control = old.system.control
        plant = extended(old.system.plant._replace(gravity=scenario.gravity), scenario, beam)
    system = System(
        plant or build_plant(scenario, beam, old.system.plant.arms if same_arms else None),
        control or build_control(scenario, beam),
        trajectory or build_trajectory(scenario),
        np.zeros((len(scenario.arms), 3)),
    )
    if same_plant and trajectory is not None and before.grips.active == scenario.grips.active:
        return system, old.rates
    return system, find_rates(beam, system, scenario.trajectory, old.rates if old.beam is beam else None)


def _same_constants(one: Scenario, other: Scenario) -> bool:
    """Whether a law derives the same constants from two scenarios with the same controller, beam and arms."""
    if law_of(one.controller).derive is nothing_derived:
        return True
    same_weight = one.gravity == other.gravity or one.controller.model.axial_load == "none"
    return one.trajectory == other.trajectory and same_weight


def _build_sampling(scenario: Scenario, beam: Beam, steps_per_period: int) -> Sampling:
    law, noise = scenario.controller, scenario.controller.sensor_noise
    return Sampling(
        law.control_period or 0.0,
        max(steps_per_period, 1),
        law.input_delay,
        np.array([*noise.pose, *noise.pose_rate, *noise.moment_rate]),
        gauge_noise(scenario, beam),
        build_strains(scenario, beam),
        noise.strain,
        noise.seed,
        np.zeros((law.input_delay + 1, len(scenario.arms), 3)),
    )


def build_strains(scenario: Scenario, beam: Beam) -> np.ndarray:
    """`Sampling.strain` of a scenario; a continuous law has no gauges."""
    payload, law = scenario.payload, scenario.controller
    places = () if law.control_period is None else law_of(law).gauges(law)
    where = payload.length * np.array(places, dtype=float)
    if not len(where):
        return np.zeros((0, len(beam.modes.omega)))
    rows = strain_rows(where, payload.length, payload.thickness, payload.element_count, payload.boundary)
    return np.ascontiguousarray(product(rows, beam.modes.V))


def gauge_noise(scenario: Scenario, beam: Beam) -> np.ndarray:
    """`Sampling.gauge_noise` of a scenario, (2, gauges): σ_ε W / T_c; (2, 0) without noise or sampling."""
    law, payload = scenario.controller, scenario.payload
    if law.control_period is None or law.sensor_noise.strain == 0:
        return np.zeros((2, 0))
    places, weights = gauge_places(payload.length)
    rows = strain_rows(places, payload.length, payload.thickness, payload.element_count, payload.boundary)
    moments = load_moments(beam.matrices, payload.bending_stiffness, payload.thickness, weights, rows)
    return np.ascontiguousarray(law.sensor_noise.strain / law.control_period * moments)
