"""Work and precision: the cost of each integrator, step and mesh, and its distance from an accurate reference."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexlab.benchmarks.measure import LEAST_TIME, SAMPLE_PERIOD, Trial, largest_difference, try_out
from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

ASKED_ERROR = 1e-6
"""Pose error for which all goals are stated, m, rad."""
GOALS = {2: 3.0, 8: 6.0, 32: 25.0, 64: 60.0}
"""Elements → ms of processor time per simulated second at `ASKED_ERROR`, nodal damping."""
PAPER_LIMIT, PAPER_AIM = 5.0, 2.0
"""Limit and aim for the paper's run, ms of processor time per simulated second."""
STEPS = {
    "etdrk4": (1e-3, 5e-4, 2.5e-4),
    "rk4": (1e-3, 5e-4, 2.5e-4),
    "generalized-alpha": (1e-3, 5e-4, 2.5e-4, 1.25e-4),
}
"""Steps of the table, s; rk4 also has its longest stable step."""
REFERENCE_STEP = 2.5e-5
"""Step of the reference, s, a fortieth of the longest step: at order 4 its error is a millionth of that step's."""
MOST_WORK = 1e6
"""Largest number of steps times elements in one measurement: seconds of processor time."""
LOOSEST = 1e-4
"""Accuracy with which stability alone limits the automatic step, m."""


@dataclass(frozen=True)
class WorkPoint:
    """One row of the table: an integrator on a mesh with a step."""

    integrator: str
    elements: int
    step: float | None
    """s; None: shorter than the shortest allowed step."""
    outcome: str
    """"measured", or the reason without figures: "unstable" (refused), "diverged", "too slow" (not run)."""
    us_per_step: float | None = None
    ms_per_second: float | None = None
    pose_error: float | None = None
    """Largest over the run, m or rad."""
    deflection_error: float | None = None
    """Largest over the run, at mid-span, m."""

    @property
    def exact_enough(self) -> bool:
        """Whether the row has a pose error within `ASKED_ERROR`."""
        return self.pose_error is not None and self.pose_error <= ASKED_ERROR


@dataclass(frozen=True)
class MeshPrecision:
    """The table of one mesh."""

    elements: int
    goal: float
    """ms of processor time per simulated second at `ASKED_ERROR`."""
    reference_uncertainty: float
    """Pose difference of the reference from one with twice its step, m or rad: about 15 times its own error."""
    points: list[WorkPoint]

    @property
    def fastest(self) -> WorkPoint | None:
        """The cheapest row within `ASKED_ERROR`."""
        good = [point for point in self.points if point.exact_enough]
        return min(good, key=lambda point: point.ms_per_second or 0.0, default=None)


@dataclass(frozen=True)
class PaperCost:
    """The paper's run with one setting."""

    setting: str
    samples_at_1_khz: bool
    step: float
    """s."""
    ms_per_second: float
    pose_error: float
    """m or rad."""


def variant(elements: int, integrator: str = "etdrk4", step: float | None = None) -> Scenario:
    """The paper's experiment on another mesh, with a given integrator and step (s, None: the engine's choice)."""
    numerics = {"payload.element_count": elements, "simulation.integrator": integrator, "simulation.step": step}
    return load_preset("paper").replace(numerics)


def reference(elements: int, duration: float) -> tuple[Samples, float]:
    """The reference motion, and its pose difference, m or rad, from a solution with twice the step."""
    fine = try_out(variant(elements, "etdrk4", REFERENCE_STEP), duration, 1).samples
    coarse = try_out(variant(elements, "etdrk4", 2 * REFERENCE_STEP), duration, 1).samples
    return fine, largest_difference(coarse.pose, fine.pose)


def paper_costs(duration: float, repeats: int) -> list[PaperCost]:
    """The paper's run with the longest step for 1 kHz samples, with the longest step, and as the preset has it."""
    exact, _ = reference(2, duration)
    costs = []
    for setting, step, every in (
        ("1 ms steps, 1 kHz samples", 1e-3, 1),
        ("2 ms steps, 500 Hz samples", 2e-3, 2),
        ("as the preset runs, 1 kHz samples", None, 1),
    ):
        scenario = variant(2, "auto" if step is None else "etdrk4", step)
        trial = try_out(scenario, duration, repeats, every * SAMPLE_PERIOD, LEAST_TIME)
        error = largest_difference(trial.samples.pose, exact.pose[every - 1 :: every])
        costs.append(PaperCost(setting, every == 1, trial.step, trial.ms_per_second, error))
    return costs


def mesh_precision(elements: int, duration: float, repeats: int) -> MeshPrecision:
    """Measure all rows of one mesh."""
    exact, uncertainty = reference(elements, duration)
    points = []
    for integrator, steps in STEPS.items():
        points += [_measured(integrator, elements, step, exact, repeats) for step in steps]
        if integrator == "rk4" and not any(point.exact_enough for point in points if point.integrator == "rk4"):
            points.append(_longest_stable_rk4(elements, exact))
    return MeshPrecision(elements, GOALS[elements], uncertainty, points)


def _measured(integrator: str, elements: int, step: float, exact: Samples, repeats: int) -> WorkPoint:
    try:
        duration = len(exact) * SAMPLE_PERIOD
        trial = try_out(variant(elements, integrator, step), duration, repeats, least_time=LEAST_TIME)
    except ScenarioError:
        return WorkPoint(integrator, elements, step, "unstable")
    return _point(integrator, elements, trial, exact)


def _longest_stable_rk4(elements: int, exact: Samples) -> WorkPoint:
    scenario = variant(elements, "rk4").replace({"simulation.accuracy": LOOSEST})
    duration = len(exact) * SAMPLE_PERIOD
    try:
        step = World(scenario, SAMPLE_PERIOD).step
    except ScenarioError:
        return WorkPoint("rk4", elements, None, "too slow")
    if duration / step * elements > MOST_WORK:
        return WorkPoint("rk4", elements, step, "too slow")
    return _point("rk4", elements, try_out(scenario, duration, 1), exact)


def _point(integrator: str, elements: int, trial: Trial, exact: Samples) -> WorkPoint:
    if not trial.completed:
        return WorkPoint(integrator, elements, trial.step, "diverged")
    names = ("pose", "midspan_deflection")
    errors = (largest_difference(getattr(trial.samples, name), getattr(exact, name)) for name in names)
    return WorkPoint(integrator, elements, trial.step, "measured", trial.us_per_step, trial.ms_per_second, *errors)


EXPONENT_GOAL = 1.2
"""Goal for the exponent of the cost over the number of elements."""
MESHES = (2, 4, 8, 16, 32, 64)  # elements
FIRST_FITTED = 8
"""Smallest number of elements in the fit; on coarser meshes arms and controller cost more than the beam."""
STEP = 1e-3  # s


@dataclass(frozen=True)
class MeshCost:
    """The cost of one mesh with modal damping and steps of 1 ms."""

    elements: int
    us_per_step: float
    real_time_factor: float
    """Simulated seconds per second of processor time."""


@dataclass(frozen=True)
class Scaling:
    """Cost against the number of elements."""

    meshes: list[MeshCost]
    exponent: float
    """Slope of log cost over log elements, from `FIRST_FITTED` elements on."""


def fitted_exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """Slope of the straight line through (log size, log cost), by least squares."""
    return float(np.polyfit(np.log(sizes), np.log(costs), 1)[0])


def mesh_scaling(duration: float, repeats: int) -> Scaling:
    """Measure the cost over the number of elements with modal damping, which does not couple modes."""
    meshes = []
    for elements in MESHES:
        modal = variant(elements, "etdrk4", STEP).replace({"payload.damping": {"kind": "modal", "ratio": 0.01}})
        trial = try_out(modal, duration, repeats, least_time=LEAST_TIME)
        meshes.append(MeshCost(elements, trial.us_per_step, trial.real_time_factor))
    fitted = [mesh for mesh in meshes if mesh.elements >= FIRST_FITTED]
    return Scaling(meshes, fitted_exponent([m.elements for m in fitted], [m.us_per_step for m in fitted]))
