"""The integrator and the step that a scenario gets."""

import math
from collections.abc import Sequence
from decimal import ROUND_DOWN, Context
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from flexlab.errors import ScenarioError
from flexlab.numerics.linear_algebra import product
from flexlab.numerics.matrix_functions import Functions
from flexlab.scenario import Scenario
from flexlab.scenario.scenario import SMALLEST_STEP
from flexlab.sim.build import Beam
from flexlab.sim.closed_loop import System
from flexlab.sim.integrators.etdrk4 import beam_operators, block_functions
from flexlab.sim.integrators.generalized_alpha import effective_inverse
from flexlab.sim.integrators.scheme import ORDER, GeneralizedAlpha, Scheme
from flexlab.sim.integrators.step import STABILITY_LIMIT
from flexlab.sim.step_rates import Rates, control_rate, grip_rates, joint_rate, motor_rate
from flexlab.text import number_text

REFERENCE_STEP = 1e-3
REFERENCE_ERROR = {"rk4": 6e-8, "etdrk4": 3e-8, "generalized-alpha": 6e-6}
"""Largest pose error of the paper's run with `REFERENCE_STEP` (s) over all meshes, m (`flexlab bench`)."""
SHORTEST_STEP = 1e-5
"""Shortest automatic step for accuracy, s: a second-order method that needs a shorter one would never finish."""
LONGEST_STEP = 2e-3
"""Longest automatic step, s: with a longer one, the 1 kHz samples of the live lab would lie within steps."""
DEFAULT_ACCURACY = 1e-10
"""Pose accuracy, m, for which the limits below are given."""
CONTROL_LIMIT, COARSEST_CONTROL_LIMIT = 0.2, 0.4
"""Largest step times fastest closed-loop rate: for the default accuracy, so that start-up transients are exact to a few 1e-6; and
for any accuracy, well inside the methods' stability (2.8)."""
CONTROLLED_STEP = 2e-5
"""Step, s, below which only stability counts: no arm follows what a law does in less time."""
COUPLING_LIMIT, COUPLED_STEP = 0.1, 1e-5
"""Largest step times `Rates.coupling`, of the part of the beam that etdrk4 does not propagate exactly, for the default accuracy;
a step below the second number, s, is never asked for: only the highest modes would gain."""
FADING_LIMIT = 0.3
"""`COUPLING_LIMIT` for modes that decay within `step_rates.FADED`: in a smooth motion they show their quasi-static bending alone,
and steps after a start or a change are shorter (`step_levels`)."""
STABLE_COUPLING = 1.0
"""Largest step times `Rates.coupling` with which etdrk4 is stable, with a margin of two."""
SHORTEST_CHOSEN = SMALLEST_STEP
"""Shortest step that is taken, at the start or in a run, s."""
RINGING_LIMIT, RINGING_DECAY = 0.01, 1.0
"""`COUPLING_LIMIT` where errors of the modes add up, as no mode decays faster than the second number, 1/s."""
RESOLVED, RESOLVED_MODES, RESOLVED_ANGLE = 0.5, 3, 0.05
"""Share of its stability limit, number of a mode, and step times its frequency, that bound automatic steps of rk4. rk4 takes
(ωΔt)⁶/72 of a mode's energy per step: with these bounds, the modes that a motion excites keep theirs to 1e-6 over 10 s."""
SOFT_BEAM = 0.03
"""Step times the beam's fastest rate below which rk4's error in its stiffest mode is under 1e-9 of its amplitude a step."""
GRIPPED_ANGLE = 0.1
"""Largest step of rk4 times frequency of the grips' springs with a rigid beam: rk4 then takes 1e-8 of a vibration per step."""
SHORTENED = Context(prec=3, rounding=ROUND_DOWN)
"""Makes the text of a longest step no longer than that step."""
TOLD = 12
"""Digits of a refused period: with fewer it would look like one that is allowed."""
SMALLEST_COMMON_STEP = 1e-6
"""Shortest step that aligning samples with control instants may force, s."""


class Choice(NamedTuple):
    """Integrator and step."""

    integrator: str
    step: float
    """The longest step, s."""
    bound: str
    """What bounds the step: "beam", "creep" (`Rates.overdamped`), "law", "joints", "motors", "grips" or "given"; once it
    divides the periods also "period" or "resonance" (`parametric_resonance`)."""


def choose_step(scenario: Scenario, system: System, beam: Beam, rates: Rates) -> Choice:
    """Integrator and longest step for accuracy, stability and the scenario's settings.

    Raises `ScenarioError` for a given step that is unstable.
    """
    simulation, beam_speed, grips = scenario.simulation, rates.beam, grip_rates(system, rates.poses)
    integrator, others = simulation.integrator, other_integrators(scenario)
    speeds = {
        "law": control_rate(system, rates.poses),
        "joints": joint_rate(system, rates.poses),
        "motors": motor_rate(system),
    }
    control_speed = sum(speeds.values())
    if integrator == "auto" and others:
        # Other integrators need a constant mass and rigid grips to propagate the modes.
        integrator = "rk4"
    elif integrator == "auto":
        # Exact propagation of the modes pays unless the beam is so slow that rk4 resolves all of them.
        step = simulation.step or _accurate_step("rk4", simulation.accuracy, control_speed)
        integrator = "rk4" if step * beam_speed < SOFT_BEAM else "etdrk4"
    fastest, hard = beam_speed, grips.ringing + grips.fading > beam_speed
    if scenario.grips.active:
        fastest = math.sqrt(beam_speed**2 + grips.ringing**2) + grips.fading
    stable = STABILITY_LIMIT / fastest if integrator == "rk4" else math.inf
    if simulation.step is not None:
        if simulation.step > stable:
            etdrk4 = "" if others else "etdrk4, "
            longest = number_text(float(SHORTENED.create_decimal_from_float(stable)))
            sentence = (
                f"A step of {number_text(simulation.step)} s (simulation.step) is unstable with rk4: "
                f"{'the grips allow at most' if hard else 'the stiffest mode of this beam allows at most'} "
                f"{longest} s. Choose a shorter step, {etdrk4}or null for an automatic step."
            )
            raise ScenarioError([("simulation.step", sentence)])
        return Choice(integrator, simulation.step, "given")
    ease = _root(simulation.accuracy / DEFAULT_ACCURACY, ORDER[integrator])
    fades = float(beam.modes.D.diagonal().max()) / 2 > RINGING_DECAY
    coupled, coupling = math.inf, rates.coupling
    if coupling > 0:
        lasting = (COUPLING_LIMIT if fades else RINGING_LIMIT) / max(rates.lasting, 1e-9 * coupling)
        accurate = max(COUPLED_STEP, ease * min(lasting, FADING_LIMIT / coupling))
        coupled = min(STABLE_COUPLING / coupling, accurate)
    if integrator == "rk4":
        third = float(np.sort(beam.modes.omega)[:RESOLVED_MODES][-1]) / math.sqrt(scenario.payload.mass_change.lightest)
        stable = min(RESOLVED * stable, RESOLVED_ANGLE / third)
    gripped = GRIPPED_ANGLE / grips.slow if grips.slow > 0 else math.inf  # 0 also if the arms can take no pose.
    hard, stable = hard or gripped < stable, min(stable, gripped)
    creeping = rates.overdamped if integrator == "etdrk4" else math.inf
    longest = {
        "creep": creeping,
        "grips" if hard else "beam": min(stable, coupled),
        max(speeds, key=speeds.__getitem__): _accurate_step(integrator, simulation.accuracy, control_speed),
    }
    bound = min(longest, key=longest.__getitem__)
    _refuse_tiny(longest[bound], integrator, bound, others)
    return Choice(integrator, longest[bound], bound)


def other_integrators(scenario: Scenario) -> str:
    """What a scenario must change so that other integrators than rk4 can be used; empty if they can."""
    mass = "a mass that stays (payload.mass_change.factor = 1)" if scenario.payload.mass_change.active else ""
    grips = "rigid grips (grips.model = rigid)" if scenario.grips.active else ""
    return " and ".join(filter(None, (mass, grips)))


def _refuse_tiny(step: float, integrator: str, bound: str, others: str) -> None:
    """Raise `ScenarioError` for a step below `SHORTEST_CHOSEN`; `bound` as of `Choice`, `others` as of `other_integrators`."""
    if step >= SHORTEST_CHOSEN:
        return
    least = number_text(SHORTEST_CHOSEN)
    need = f"would need a step of {number_text(step, 2)} s with {integrator}, below the {least} s that is allowed"
    if bound == "creep":
        # How short the step would have to be is unknown, and nobody can set it.
        need = f"would need steps below the {least} s that are allowed with {integrator}"
    auto = f"or {others}, " if others else "" if integrator == "etdrk4" else "or the integrator auto, "
    own_step = f"{auto}or set the step yourself (simulation.step)"
    causes = {
        "creep": "this beam, strongly damped and heavy for arms that give way to it,",
        "beam": "the beam's fastest mode in these arms",
        "joints": "the joints' friction",
        "motors": "the motors' time constant",
        "grips": "the grips' stiffness and damping",
        "law": "the controller's gains",
    }
    cures = {
        "creep": "Choose a softer, lighter or less damped beam, fewer elements, or heavier links",
        "beam": f"Choose a softer or less damped beam or fewer elements, {own_step}",
        "joints": "Choose a higher speed within which friction changes sign (joints.friction.smoothing_speed), or less friction",
        "motors": "Choose a longer time constant of the motors (joints.motor.time_constant), or 0",
        "grips": f"Choose a lower stiffness or damping of the grips (grips.stiffness, grips.damping), {auto}or fewer elements",
        "law": f"Lower the gains, {own_step}",
    }
    sentence = f"No automatic step (simulation.step = null) is short enough: {causes[bound]} {need}. {cures[bound]}."
    raise ScenarioError([("simulation.step", sentence)])


def control_limits(integrator: str, accuracy: float) -> tuple[float, float]:
    """Longest step times fastest closed-loop rate for a pose accuracy, m, and for any accuracy."""
    ease = _root(accuracy / DEFAULT_ACCURACY, ORDER[integrator])
    return CONTROL_LIMIT * ease, COARSEST_CONTROL_LIMIT


def _accurate_step(integrator: str, accuracy: float, control_speed: float) -> float:
    """Longest step for a pose accuracy, m, that also resolves the closed loop's fastest rate, 1/s."""
    wish = REFERENCE_STEP * _root(accuracy / REFERENCE_ERROR[integrator], ORDER[integrator])
    period = 1 / max(control_speed, 1e-3 / LONGEST_STEP)
    wished, coarsest = control_limits(integrator, accuracy)
    controlled = min(coarsest * period, max(wished * period, CONTROLLED_STEP))
    return min(LONGEST_STEP, max(wish, SHORTEST_STEP), controlled)


class Count(NamedTuple):
    """The number of steps in each period."""

    per_tick: int
    per_control: int
    """0 for continuous control."""
    step: float
    """s."""


def _root(value: float, order: int) -> float:
    """value^(1/order) for an order of 2 or 4, by square roots, which are the same on every machine."""
    return math.sqrt(value) if order == 2 else math.sqrt(math.sqrt(value))


def steps_per_tick(scenario: Scenario, tick_period: float, step: float) -> Count:
    """Steps per sample and per control period, so that both lie on steps no longer than `step`.

    Raises `ScenarioError` if the two periods have no common step worth taking.
    """
    control_period = scenario.controller.control_period
    if control_period is None:
        count = max(1, math.ceil(tick_period / step - 1e-9))
        return Count(count, 0, tick_period / count)
    tick, control = (Fraction(period).limit_denominator(10**9) for period in (tick_period, control_period))
    common = Fraction(math.gcd(tick.numerator * control.denominator, control.numerator * tick.denominator)) / (
        tick.denominator * control.denominator
    )
    if common < SMALLEST_COMMON_STEP:
        given, sampled = (number_text(period, TOLD) for period in (control_period, tick_period))
        least = number_text(SMALLEST_COMMON_STEP)
        text = (
            f"controller.control_period = {given} s and the sample period {sampled} s have no common step above {least} s: "
            f"choose a multiple of {least} s."
        )
        raise ScenarioError([("controller.control_period", text)])
    step_count = max(1, math.ceil(float(common) / step - 1e-9))
    count = int(tick / common) * step_count
    return Count(count, int(control / common) * step_count, tick_period / count)


def build_scheme(integrator: str, beam: Beam, dt: float, known: Sequence[Sequence[Functions]] = ()) -> Scheme:
    """The integrator's constants for step dt; `known`: the `block_functions` of dt and dt/2, if they have been computed."""
    modes = beam.modes
    loads = product(np.stack([beam.matrices.h, beam.matrices.g]), modes.V)
    if integrator == "etdrk4":
        linear = (modes.omega, modes.D, modes.block_start)
        functions = known or [block[:2] for block in block_functions(*linear, dt)]
        return Scheme(etdrk4=beam_operators(*linear, loads, dt, functions))
    if integrator == "generalized-alpha":
        inverse = effective_inverse(modes.omega, modes.D, modes.block_start, dt)
        return Scheme(generalized_alpha=GeneralizedAlpha(inverse, product(loads, inverse)))
    return Scheme(rk4=True)
