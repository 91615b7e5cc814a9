"""Whether a run keeps up with real time: estimated when its step is chosen, and said before anybody waits for it."""

from typing import NamedTuple

import numpy as np

from flexlab.number_text import number_text
from flexlab.sim.build import Beam

SLOWEST_PACE = 0.8
"""Processor seconds per simulated second, on the machine of the costs below, from which on a run is announced as slow."""


class StepCost(NamedTuple):
    """Processor time of a step, measured on one core of a shared server in November 2026 (`flexlab bench` measures any)."""

    fixed: float
    """Of arms and law, s."""
    per_mode: float
    """s."""
    per_product: float
    """Of each number of the beam's matrices that couple modes, s."""


STEP_COSTS = {
    "etdrk4": StepCost(1.6e-6, 3.5e-8, 2.6e-9),
    "rk4": StepCost(1.2e-6, 3.5e-8, 4e-10),
    "generalized-alpha": StepCost(2.6e-6, 8.5e-8, 1.4e-9),
}

COUPLED_MODES = 8
"""Modes that damping couples from which on they, and not the arms, are what a step costs."""


def seconds_per_second(integrator: str, beam: Beam, step: float) -> float:
    """Estimated processor time per simulated time with steps of `step` s, 1."""
    cost, sizes = STEP_COSTS[integrator], np.diff(beam.modes.block_start)
    products = float(np.sum(sizes[sizes > 1] ** 2))
    return (cost.fixed + cost.per_mode * float(np.sum(sizes)) + cost.per_product * products) / step


def pace_warning(integrator: str, beam: Beam, step: float, bound: str, mass_changes: bool = False) -> str:
    """A sentence if a run is estimated to be slower than real time, what makes it so and what to change; else empty.

    bound: what the step was chosen by, as `step_size.Choice.bound`; mass_changes: whether only rk4 goes such a payload.
    """
    pace = seconds_per_second(integrator, beam, step)
    if pace < SLOWEST_PACE:
        return ""
    size = number_text(1e6 * step, 3)
    causes = {
        "given": f"simulation.step = {number_text(step)} s",
        "beam": f"the modes of this beam in these arms need steps of {size} µs with {integrator}",
        "creep": f"the modes of this beam, strongly damped and heavy for these arms, need steps of {size} µs",
        "growth": f"modes that next to nothing damps need steps of {size} µs, for their errors not to grow",
        "accuracy": f"what the start or the path's kinks excite needs steps of {size} µs with {integrator}",
        "joints": f"the joints' friction needs steps of {size} µs",
        "motors": f"the motors' time constant needs steps of {size} µs",
        "law": f"the controller needs steps of {size} µs with {integrator}",
        "period": f"sample and control period leave steps of {size} µs",
    }
    cures = {
        "given": ["a longer simulation.step, or null"],
        "beam": ["a softer beam", "a coarser simulation.accuracy"],
        "creep": ["less damping", "a softer or lighter beam"],
        "growth": ["some damping (payload.damping)", "a softer beam"],
        "accuracy": ["a smooth start", "more damping", "a softer beam"],
        "joints": ["a higher joints.friction.smoothing_speed", "a coarser simulation.accuracy"],
        "motors": ["a longer joints.motor.time_constant, or 0", "a coarser simulation.accuracy"],
        "law": ["lower gains", "a coarser simulation.accuracy"],
        "period": ["a control period that is a multiple of the sample period"],
    }[bound]
    cause, modes = causes[bound], len(beam.modes.omega)
    if np.max(np.diff(beam.modes.block_start)) > COUPLED_MODES:
        cause += f" and the damping couples its {modes} modes"
        cures = ["damping of kind modal or stiffness, which couples none", *cures]
    if modes > COUPLED_MODES:
        cures = [*cures, "fewer elements or modes (payload.mode_count)"]
    if mass_changes:
        cures = [*cures, "a mass that stays (payload.mass_change.factor = 1)"]
    elif integrator != "etdrk4" and bound != "given":
        cures = ["the integrator auto", *cures]
    return (
        f"Slower than real time: a simulated second takes about {number_text(pace, 2)} s on a common processor, as {cause}. "
        f"To keep up, choose {_either(cures)}."
    )


def _either(choices: list[str]) -> str:
    """The choices in a sentence, as in "a, b or c"."""
    return " or ".join([", ".join(choices[:-1]), choices[-1]] if len(choices) > 1 else choices)
