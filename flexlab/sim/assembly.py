"""Everything that is derived from a scenario and then only used: kernel constants, integrator, sampling.

Each part is a pure function of a part of the scenario, so one that is known from before may be taken as it is: a gain costs
a gain, and live, headless and replayed runs have the same bits whatever they knew.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlab.control.law import law_of, laws, nothing_derived
from flexlab.control.path import paths
from flexlab.numerics.linear_algebra import product
from flexlab.physics.grips import build_grips
from flexlab.physics.joints import build_joints
from flexlab.physics.sensors import gauge_places, load_moments, strain_rows
from flexlab.scenario import Scenario
from flexlab.sim.advance import advance
from flexlab.sim.build import Beam, build_beam, build_control, build_plant
from flexlab.sim.closed_loop import System, new_workspace, state_length
from flexlab.sim.integrators.scheme import Scheme
from flexlab.sim.sampled_control import LoopForm, Sampling, form_of, is_loaded, loop_form, with_kernel
from flexlab.sim.samples import check_signal_names
from flexlab.sim.step_growth import may_grow, steadiest
from flexlab.sim.step_levels import StepLevels, StepWatch
from flexlab.sim.step_rates import Rates, amplifies_errors, find_rates, free_beam_rate
from flexlab.sim.step_size import Count, choose_step, steps_per_tick
from flexlab.sim.target import build_trajectory, same_target

LIGHT_ELEMENTS = 8
"""Elements up to which modes and matrix functions are derived in a millisecond or two."""


FORCED = 0.4
"""Step taken over step chosen below which the sample and control periods are what makes it short: dividing a tick into whole
steps alone leaves more than half."""


MUCH_SHORTER = 1.25
"""Step asked for over step taken from which on errors that would grow are what makes it short."""


class Unprepared(Exception):
    """A world was asked to take on at once what takes long to derive; `scenario` is what to derive it for."""

    def __init__(self, scenario: Scenario):
        super().__init__("to be derived beside the running world")
        self.scenario = scenario


class Assembly(NamedTuple):
    """What is derived from a scenario and a tick period."""

    scenario: Scenario
    beam: Beam
    free_rate: float
    """As `step_size.free_beam_rate`, 1/s."""
    system: System
    rates: Rates
    sampling: Sampling
    levels: StepLevels
    watch: StepWatch
    steps: Count
    """At level 0."""
    asked: Count
    """The same before they were made shorter so that errors do not grow."""
    bound: str
    """What the step was chosen by, as `step_size.Choice.bound`, or "accuracy" (`step_trial`)."""
    amplifies: bool = False
    """Whether a sampled loop answers each error with a larger one (`step_rates.amplifies_errors`)."""
    whole: "Assembly | None" = None
    """The same before its step was halved so that the run's beginning is accurate; None: it was not."""

    @property
    def step_count(self) -> int:
        """Integration steps per tick at level 0."""
        return self.steps.per_tick


def build_assembly(
    scenario: Scenario, tick_period: float, known: Sequence[Assembly] = (), at_once: bool = False
) -> Assembly:
    """Derive everything from a scenario; raises `ScenarioError`. Parts of `known` assemblies are shared where they fit.

    `at_once`: raise `Unprepared` instead of deriving what takes long.
    """
    check_signal_names(scenario)
    law = scenario.controller
    if at_once and not laws()[law.kind].is_ready(law):
        raise Unprepared(scenario)
    same_beam = [old for old in known if old.scenario.payload == scenario.payload]
    whole = [[old.whole or old for old in some] for some in (known, same_beam)]
    return _refined(_derive(scenario, tick_period, *whole, at_once), tick_period, known, at_once)


def _derive(
    scenario: Scenario, tick_period: float, known: Sequence[Assembly], same_beam: Sequence[Assembly], at_once: bool
) -> Assembly:
    """As `build_assembly`; `same_beam`: what is known of the same beam."""
    if at_once and not knows_kernels(scenario):
        raise Unprepared(scenario)
    must_wait, at_once = at_once, at_once and scenario.payload.element_count > LIGHT_ELEMENTS
    if same_beam:
        beam, free_rate = same_beam[0].beam, same_beam[0].free_rate
    elif at_once:
        raise Unprepared(scenario)
    else:
        beam = build_beam(scenario.payload)
        free_rate = free_beam_rate(beam, scenario.payload.mass_change.lightest)
    system, rates = _close_loop(scenario, beam, free_rate, same_beam[:1] or known[:1])
    integrator, step, bound = choose_step(scenario, system, beam, rates)
    asked = steps = steps_per_tick(scenario, tick_period, step)
    if integrator == "etdrk4" and bound != "given" and may_grow(beam, rates, asked.step):
        alike = [old.steps for old in same_beam if _grows_alike(old, scenario, asked)]
        if at_once and not alike:
            raise Unprepared(scenario)
        steps = alike[0] if alike else _steady_steps(scenario, system, beam, rates, tick_period, asked)
        if steps.step < asked.step / MUCH_SHORTER:
            bound = "growth"
    dt = steps.step
    if asked.step < FORCED * step and asked.per_tick > 1:
        bound = "period"
    fitting = [old.levels for old in same_beam if (old.levels.integrator, old.levels.step) == (integrator, dt)]
    if (at_once and not fitting) or (must_wait and (integrator, loop_form(system.plant)) not in _loaded):
        raise Unprepared(scenario)
    levels = fitting[0] if fitting else StepLevels(integrator, beam, dt)
    watch = levels.watch(scenario.simulation.step is not None, scenario.simulation.accuracy)
    for level in range(watch.disturbed + 3):  # and the quarter of a step of `accuracy`
        levels.scheme(level)
    sampling = _build_sampling(scenario, beam, steps.per_control)
    if system.control.sampled:
        sampling = with_kernel(sampling, system)
    if (integrator, loop_form(system.plant)) not in _loaded:
        load_loop(system, sampling, levels.scheme(0), watch, tick_period, steps.per_tick)
        _loaded.add((integrator, loop_form(system.plant)))
    amplifies = amplifies_errors(system, rates.poses, sampling.period, sampling.delay)
    return Assembly(scenario, beam, free_rate, system, rates, sampling, levels, watch, steps, asked, bound, amplifies)


def _refined(assembly: Assembly, tick_period: float, known: Sequence[Assembly], at_once: bool) -> Assembly:
    """With the step that a trial asks for, if nobody gave one."""
    from flexlab.sim.step_trial import halved, halvings  # It sets in motion what is assembled here.

    if assembly.scenario.simulation.step is not None:
        return assembly
    for old in known:
        if old.scenario == assembly.scenario and (old.whole or old).steps == assembly.steps:
            return halved(assembly, (old.steps.per_tick // assembly.steps.per_tick).bit_length() - 1)
    return halved(assembly, halvings(assembly, tick_period, at_once))


def _steady_steps(
    scenario: Scenario, system: System, beam: Beam, rates: Rates, tick_period: float, asked: Count
) -> Count:
    """As `step_growth.steadiest`, at the middle of the path: a path that is changed in motion keeps it."""
    pose = np.array(scenario.trajectory.middle)
    return steadiest(system, beam, rates, pose, asked, lambda most: steps_per_tick(scenario, tick_period, most))


def _grows_alike(old: Assembly, scenario: Scenario, asked: Count) -> bool:
    """Whether the same beam's errors were looked at before, of the steps asked for, and all that counts is the same."""
    before = old.scenario
    return (
        old.asked == asked
        and old.levels.integrator == "etdrk4"
        and before.simulation == scenario.simulation  # Steps that somebody gave were not looked at.
        and before.trajectory.middle == scenario.trajectory.middle
        and before.controller.control_period == scenario.controller.control_period
        and before.arms == scenario.arms
    )


_loaded: set[tuple[str, LoopForm]] = set()
"""Integrators whose loop is in memory, each with the `loop_form` that it is for."""


def knows_kernels(scenario: Scenario) -> bool:
    """Whether the scenario's law and path, kind of plant and, if it wants it, sampled control have been compiled or loaded."""
    parts = law_of(scenario.controller), paths()[scenario.trajectory.kind]
    form = form_of(scenario)
    if form != LoopForm() and all(loaded != form for _, loaded in _loaded):
        return False
    return all(part.is_loaded for part in parts) and (scenario.controller.control_period is None or is_loaded(form))


def load_loop(
    system: System, sampling: Sampling, scheme: Scheme, watch: StepWatch, tick_period: float, step_count: int
) -> None:
    """Compile the loop with an integrator, or load it, by going no tick."""
    y = np.zeros(state_length(system))
    rows, ws = np.zeros((0, 1)), new_workspace(system)
    advance(system, sampling, *scheme, watch, 0, np.inf, 0.0, 0, tick_period, step_count, y, y.copy(), ws, rows, False)


def _close_loop(scenario: Scenario, beam: Beam, free_rate: float, known: Sequence[Assembly]) -> tuple[System, Rates]:
    """Plant, law and path, with motors off until a sampled controller first acts."""
    plant = control = trajectory = rates = arms = forms = None
    for old in known:
        if same_target(old.scenario, scenario):
            trajectory = old.system.trajectory
        if old.scenario.arms != scenario.arms or old.scenario.payload.length != scenario.payload.length:
            continue
        arms = old.system.plant.arms
        if old.beam is beam:
            if old.scenario.controller == scenario.controller and _same_constants(old.scenario, scenario):
                control = old.system.control
            own = build_joints(scenario.joints, scenario.controller.model, len(scenario.arms))
            grips = build_grips(scenario.grips, len(scenario.arms))
            plant = old.system.plant._replace(gravity=scenario.gravity, joints=own, grips=grips)
            alike = trajectory is not None and old.scenario.grips.active == scenario.grips.active
            rates, forms = old.rates if alike else None, old.rates.forms
    system = System(
        plant or build_plant(scenario, beam, arms),
        control or build_control(scenario, beam),
        trajectory or build_trajectory(scenario),
        np.zeros((len(scenario.arms), 3)),
    )
    return system, rates or find_rates(beam, system, scenario.trajectory, free_rate, forms)


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
    """`Sampling.strain` of a scenario; no gauges under a continuous law."""
    payload, law = scenario.payload, scenario.controller
    places = () if law.control_period is None else law_of(law).gauges(law)
    where = payload.length * np.array(places, dtype=float)
    if not len(where):
        return np.zeros((0, len(beam.modes.omega)))
    rows = strain_rows(where, payload.length, payload.thickness, payload.element_count, payload.boundary)
    return np.ascontiguousarray(product(rows, beam.modes.V))


def gauge_noise(scenario: Scenario, beam: Beam) -> np.ndarray:
    """`Sampling.gauge_noise` of a scenario, (2, gauges): σ_ε W / T_c; (2, 0) where nothing is noisy or nothing sampled."""
    law, payload = scenario.controller, scenario.payload
    if law.control_period is None or law.sensor_noise.strain == 0:
        return np.zeros((2, 0))
    places, weights = gauge_places(payload.length)
    rows = strain_rows(places, payload.length, payload.thickness, payload.element_count, payload.boundary)
    moments = load_moments(beam.matrices, payload.bending_stiffness, payload.thickness, weights, rows)
    return np.ascontiguousarray(law.sensor_noise.strain / law.control_period * moments)


def build_system(scenario: Scenario, beam: Beam) -> System:
    """Plant, control law and trajectory of a scenario, with motors off until a sampled controller first acts."""
    return System(
        build_plant(scenario, beam),
        build_control(scenario, beam),
        build_trajectory(scenario),
        np.zeros((len(scenario.arms), 3)),
    )
