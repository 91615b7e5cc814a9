"""Which integrator and which step a scenario gets."""

import math
from fractions import Fraction

import numpy as np

from flexlab.errors import ScenarioError
from flexlab.scenario import Scenario
from flexlab.sim.build import Beam
from flexlab.sim.integrators.etdrk4 import beam_operators
from flexlab.sim.integrators.rk4 import STABILITY_LIMIT
from flexlab.sim.integrators.scheme import NAMES, Scheme

LONGEST_STEP = 5e-4
"""Step of the fourth-order methods unless the scenario asks otherwise, s: pose errors stay well under 1e-6 on the paper's
motion, whatever the mesh (see `flexlab bench`)."""

SMALLEST_COMMON_STEP = 1e-6
"""Shortest step that aligning samples with control instants may force, s."""


def choose_integrator(scenario: Scenario) -> str:
    """The integrator's name; "auto" takes etdrk4, whose step does not depend on the stiffest mode."""
    asked = scenario.simulation.integrator
    return "etdrk4" if asked == "auto" else asked


def longest_step(scenario: Scenario, integrator: str, omega_max: float) -> float:
    """The longest step that accuracy and, for rk4, stability allow, s; raises `ScenarioError` for an unstable wish."""
    asked = scenario.simulation.step
    stable = STABILITY_LIMIT / omega_max if integrator == "rk4" else math.inf
    if asked is not None and asked > stable:
        raise ScenarioError(
            [
                (
                    "simulation.step",
                    f"simulation.step = {asked:g} s is unstable with rk4: the stiffest mode of this beam allows at most "
                    f"{stable:.3g} s. Choose a shorter step, etdrk4, or null for an automatic step.",
                )
            ]
        )
    return asked if asked is not None else min(LONGEST_STEP, stable)


def steps_per_tick(scenario: Scenario, tick_period: float, step: float) -> tuple[int, int]:
    """Steps per sample and per control period (0: continuous), so that both lie on steps no longer than `step`.

    Raises `ScenarioError` if the two periods have no common step worth taking.
    """
    control_period = scenario.controller.control_period
    if control_period is None:
        return max(1, math.ceil(tick_period / step - 1e-9)), 0
    tick, control = (Fraction(period).limit_denominator(10**9) for period in (tick_period, control_period))
    common = Fraction(math.gcd(tick.numerator * control.denominator, control.numerator * tick.denominator)) / (
        tick.denominator * control.denominator
    )
    if common < SMALLEST_COMMON_STEP:
        raise ScenarioError(
            [
                (
                    "controller.control_period",
                    f"controller.control_period = {control_period:g} s and the sample period {tick_period:g} s have no "
                    f"common step above {SMALLEST_COMMON_STEP:g} s: choose a multiple of {SMALLEST_COMMON_STEP:g} s.",
                )
            ]
        )
    step_count = max(1, math.ceil(float(common) / step - 1e-9))
    return int(tick / common) * step_count, int(control / common) * step_count


def build_scheme(integrator: str, beam: Beam, dt: float) -> Scheme:
    """The integrator's constants for step dt."""
    modes = beam.modes
    operators = np.zeros((5, 0))
    if integrator == "etdrk4":
        operators = beam_operators(modes.omega, modes.D, modes.block_start, dt)
    return Scheme(NAMES[integrator], operators, np.zeros((0, 0)), np.zeros((2, 0)))
