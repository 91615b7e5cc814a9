"""Which stiffness and damping a scenario needs to ring as something was seen to ring."""

from dataclasses import dataclass

import numpy as np

from flexlab.analysis.identification.ring import Estimate, RingFit
from flexlab.analysis.modes import modes
from flexlab.errors import FlexlabError
from flexlab.scenario import Scenario

ROUNDS, CLOSE = 12, 1e-9
"""Of the search, at most; relative change at which it ends."""
SEEN_AS = "beam mode 1"
"""The pole that a ring is of."""
OUT_OF_RANGE = "what rings like this lies outside the range of the field"


@dataclass(frozen=True)
class BeamParameters:
    """What follows from a ring for a scenario's beam."""

    bending_stiffness: Estimate
    linear_density: Estimate
    damping: Estimate
    """Of the field `damping_field`."""
    damping_field: str
    scenario: Scenario
    """With what could be identified."""


def beam_parameters(fit: RingFit, scenario: Scenario, in_loop: bool) -> BeamParameters:
    """EI and damping of `scenario` whose first mode rings as `fit` says, its length, density and boundary being right.

    `in_loop`: the grips are held by the scenario's arms and its law, which give way a little; otherwise by a vice.
    """
    path = "payload.damping.ratio" if scenario.payload.damping.kind == "modal" else "payload.damping.coefficient"
    frequency, ratio = fit.first.frequency, fit.first.damping_ratio
    density = Estimate(np.nan, np.nan, np.nan, "kg/m", "a ring tells EI/ρ alone; weigh the beam for ρ")
    reason = frequency.reason
    try:
        stiffness, fitted = _solve_stiffness(scenario, frequency.value, in_loop) if not reason else (np.nan, scenario)
    except FlexlabError:
        reason, stiffness, fitted = OUT_OF_RANGE, np.nan, scenario
    spread = (np.array([frequency.low, frequency.high]) / frequency.value) ** 2
    EI = Estimate(stiffness, *map(float, stiffness * spread), "N·m²", reason)
    unit = scenario.about(path).unit_text().strip()
    damping, final = _solve_damping(fitted, path, ratio, in_loop, unit if unit != "1" else "", reason)
    return BeamParameters(EI, density, damping, path, final)


def first_mode(scenario: Scenario, in_loop: bool) -> tuple[float, float]:
    """Frequency, Hz, and damping ratio of the beam's first mode, with its grips in the arms or in a vice."""
    found = modes(scenario)
    if in_loop:
        for pole, origin in zip(found.poles, found.pole_origin, strict=True):
            if origin == SEEN_AS and pole.imag > 0:
                return float(abs(pole)) / (2 * np.pi), float(-pole.real / abs(pole))
    return float(found.frequency[0]), float(found.damping_ratio[0])


def _solve_stiffness(scenario: Scenario, frequency: float, in_loop: bool) -> tuple[float, Scenario]:
    """The first mode's frequency goes with √EI, nearly: fixed-point steps."""
    stiffness = scenario.payload.bending_stiffness
    for _ in range(ROUNDS):
        step = (frequency / first_mode(scenario, in_loop)[0]) ** 2
        stiffness *= step
        scenario = scenario.replace({"payload.bending_stiffness": stiffness})
        if abs(step - 1) < CLOSE:
            break
    return stiffness, scenario


def _solve_damping(
    scenario: Scenario, path: str, ratio: Estimate, in_loop: bool, unit: str, reason: str
) -> tuple[Estimate, Scenario]:
    """The first mode's ζ is linear in the damping, nearly: secant steps."""
    if reason or ratio.reason:
        return Estimate(np.nan, np.nan, np.nan, unit, reason or ratio.reason), scenario
    start = scenario.get(path) or 1e-6
    try:
        here, there = (first_mode(scenario.replace({path: value}), in_loop)[1] for value in (start, 1.1 * start))
        slope = (there - here) / (0.1 * start)
        value, low, high = (start + (wanted - here) / slope for wanted in (ratio.value, ratio.low, ratio.high))
        for _ in range(ROUNDS):
            change = (ratio.value - first_mode(scenario.replace({path: value}), in_loop)[1]) / slope
            value, low, high = value + change, low + change, high + change
            if abs(change) < CLOSE * abs(value):
                break
        return Estimate(value, low, high, unit), scenario.replace({path: value})
    except FlexlabError:
        return Estimate(np.nan, np.nan, np.nan, unit, OUT_OF_RANGE), scenario
