"""Random scenarios within the ranges of the sliders, each compared with a run of much finer steps.

`python tests/sim/random_scenarios.py 300` judges the first 300, which takes a quarter of an hour. `--wide` also varies paths,
limits and integrators, `--axial` takes beams that feel the force along them, and `--seconds 2` limits the processor time of each
finer run. A few of the scenarios are part of the test suite.
"""

import argparse
import math
import re
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flexlab.control.law import laws
from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.quantities import describe
from flexlab.scenario import Scenario
from flexlab.scenario.payload import HELD_COORDINATES, Payload
from flexlab.sim.run_warnings import seconds_per_second
from flexlab.sim.samples import Samples
from flexlab.sim.step_levels import LIMITED_STEP
from flexlab.sim.world import World

DURATION = 0.3
"""Simulated time, s: the jerk at the start and the vibration that it leaves."""

LONGEST_REFERENCE = 8.0
"""Estimated processor time, s, after which the finer run is cut short."""

REFERENCES = (1.0, 1.09, 1.16)
"""Factors by which the steps of the finer run, a quarter or a sixteenth, are shortened further, until that run is accurate."""

SHORTEST_STEP = 1e-7
"""Shortest step that a scenario may give, s."""

SHORT_STEPS, TIMED = 30, 30
"""Ticks with shorter steps after a start, and number of ticks timed after them."""

FORCE_BOUND = 1e-4
"""Largest error of the force, relative to its peak, of a run that is called accurate."""

POSE_BOUND = 1e-8
"""Largest error of the pose, m or rad, of such a run."""

LOSS_BOUND, LEAST_LOSS = 0.01, 1e-12
"""Largest error of the dissipated energy, relative to it, of a run that does not speak of it; and the least energy judged, J."""

OF_LOSS = "The dissipated energy"
"""First words of the warning that the dissipated energy is off; it follows that of pose and force."""

EXCEEDED = 3.0
"""Factor by which an error may exceed the one that the warning states."""

DAMPINGS = (
    lambda rng: {"kind": "nodal", "coefficient": float(rng.uniform(0, 1))},
    lambda rng: {"kind": "modal", "ratio": float(rng.choice([0.0, rng.uniform(0, 0.1), rng.uniform(0, 1.5)]))},
    lambda rng: {"kind": "stiffness", "coefficient": float(10 ** rng.uniform(-6, -2.7))},
)


@dataclass(frozen=True)
class Judgement:
    """The judgement of a scenario."""

    text: str
    complaints: tuple[str, ...]
    """Complaints about its results."""
    world: World
    """The world that was judged, after its run."""


@lru_cache(maxsize=2)
def started(scenario: Scenario) -> World:
    """A world of the scenario that is never moved on: what it has derived serves further worlds."""
    return World(scenario)


def slider(rng: np.random.Generator, model: type, name: str) -> float:
    """A random value within the range of a field's slider."""
    about = describe(model, name)
    assert about.slider is not None
    low, high = about.slider
    return float(np.exp(rng.uniform(np.log(low), np.log(high))) if about.logarithmic else rng.uniform(low, high))


def random_scenario(seed: int) -> Scenario:
    """The random scenario with this seed: the first one drawn that can be built and started."""
    rng = np.random.default_rng(seed)
    while True:
        boundary = str(rng.choice(list(HELD_COORDINATES)))
        single = boundary == "clamped-free"
        law = laws()[str(rng.choice([kind for kind in laws() if kind != "none"]))]
        controller: dict = {"kind": law.kind}
        for name in law.model.model_fields:
            if rng.random() < 0.4 and describe(law.model, name).slider is not None:
                value = slider(rng, law.model, name)
                default = law.model.model_fields[name].default
                controller[name] = (value,) * 3 if isinstance(default, tuple) and len(default) == 3 else value
        if rng.random() < 0.25:
            controller["control_period"] = float(rng.choice([0.0005, 0.001, 0.002]))
        changes = {
            "payload.boundary": boundary,
            "payload.linear_density": slider(rng, Payload, "linear_density"),
            "payload.bending_stiffness": float(10 ** rng.uniform(0, rng.choice([3, 7]))),
            "payload.element_count": int(rng.choice([1, 2, 3, 4, 6, 8, 12, 16, 32, 64])),
            "payload.damping": DAMPINGS[rng.integers(3)](rng),
            "gravity": float(rng.choice([0.0, rng.uniform(0, 9.81)])),
            "trajectory.amplitude": tuple(rng.uniform(0, 0.3, 3).tolist()),
            "trajectory.frequency": (float(rng.uniform(0.1, 3)),) * 3,
            "controller": controller,
        }
        try:
            scenario = load_preset("single-arm" if single else "paper").replace(changes)
            if not started(scenario).status.failed:
                return scenario
        except ScenarioError:
            continue


def wide_scenario(seed: int) -> Scenario:
    """A random scenario with another path, shaper, sampling, delay, torque limits or integrator as well."""
    rng, scenario = np.random.default_rng([seed, 1]), random_scenario(seed)
    while True:
        path = {"kind": str(rng.choice(["sine", "rest-to-rest", "bang-bang", "circle", "figure-eight", "waypoints"]))}
        changes: dict = {
            "trajectory": path,
            "trajectory.smooth_start": float(rng.choice([0.0, 0.0, rng.uniform(0.05, 0.5)])),
        }
        changes["trajectory.shaper"] = str(rng.choice(["none", "none", "none", "zv", "zvd", "ei-shaper"]))
        changes["payload.bending_stiffness"] = float(10 ** rng.uniform(0, 6))
        if rng.random() < 0.2:
            changes["controller.torque_limit"] = tuple(
                (np.array([300, 150, 60]) * 10 ** rng.uniform(-0.5, 0.5)).tolist()
            )
        if rng.random() < 0.3:
            changes["controller.control_period"] = float(rng.choice([0.0005, 0.001, 0.002, 0.005]))
            changes["controller.input_delay"] = int(rng.integers(0, 3))
        if rng.random() < 0.2:
            changes["simulation.integrator"] = str(rng.choice(["rk4", "etdrk4", "generalized-alpha"]))
        try:
            found = scenario.replace(changes)
            if not started(found).status.failed:
                return found
        except ScenarioError:
            continue


def stated_size(what: str, warning: str) -> float:
    """The error that a warning states: of the "pose", m or rad, or of the "force", over its peak; infinite if it states none."""
    said = re.search(
        rf"{what} may be off by (?:([\d.]+) · )?([\d.]+)([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]*) (% of its peak|m or rad)", warning
    )
    if not said:
        return math.inf
    power = int(said[3].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")) or 1)
    size = float(said[1] or 1) * float(said[2]) ** power
    return size / 100 if said[4].startswith("%") else size


def stated_sizes(warning: str) -> dict[str, float]:
    """The errors of pose and force up to which a run is right: the stated one, or the bound of an accurate one if only the other
    is stated; infinite if the warning states neither."""
    bounds = {"pose": POSE_BOUND, "force": FORCE_BOUND}
    sizes = {what: stated_size(what, warning) for what in bounds}
    if warning and all(map(math.isinf, sizes.values())):
        return sizes
    return {what: bounds[what] if math.isinf(size) else max(bounds[what], size) for what, size in sizes.items()}


def with_joints(scenario: Scenario, seed: int) -> Scenario:
    """The scenario with joints that are not ideal: slow and weak motors, friction and, with sampled control, encoders."""
    rng = np.random.default_rng([seed, 2])
    while True:
        changes: dict = {}
        if rng.random() < 0.7:
            changes["joints.motor.time_constant"] = float(10 ** rng.uniform(-4, -1.7))
        if rng.random() < 0.5:
            changes["joints.motor.stall_torque"] = tuple((np.array([600, 300, 120]) * rng.uniform(0.5, 3)).tolist())
            changes["joints.motor.no_load_speed"] = tuple(rng.uniform(2, 20, 3).tolist())
        if rng.random() < 0.4:
            changes["joints.friction.viscous"] = tuple(rng.uniform(0, 10, 3).tolist())
            changes["joints.friction.coulomb"] = tuple(rng.uniform(0, 10, 3).tolist())
        if scenario.controller.control_period is not None and rng.random() < 0.3:
            changes["joints.encoders.counts"] = (float(10 ** rng.uniform(4, 7)),) * 3
        try:
            found = scenario.replace(changes)
            if not started(found).status.failed:
                return found
        except ScenarioError:
            continue


def with_mass_change(scenario: Scenario, seed: int) -> Scenario:
    """The scenario with a payload that is filled or emptied during the run."""
    rng = np.random.default_rng([seed, 3])
    names = {
        "factor": 10 ** rng.uniform(-1, 1),
        "begin": rng.uniform(0, 0.05),
        "duration": 10 ** rng.uniform(-1.5, -0.3),
    }
    changes = {f"payload.mass_change.{name}": float(value) for name, value in names.items()}
    changes["controller.model.mass_change_factor"] = float(rng.choice([0.0, 0.5, 1.0]))
    filled = scenario.replace({"simulation.integrator": "auto"}).replace(changes)
    try:
        World(filled)
    except ScenarioError:  # Too fine and stiff for rk4, the only integrator for a changing mass.
        changes = {"payload.element_count": 2, "payload.mode_count": None, "payload.bending_stiffness": 100.0}
        filled = filled.replace({**changes, "payload.damping": {"kind": "nodal", "coefficient": 0.1}})
    return filled


def with_grips(scenario: Scenario, seed: int) -> Scenario:
    """The scenario with compliant grips."""
    rng = np.random.default_rng([seed, 4])
    firm = 10 ** rng.uniform(3, 7)
    stiffness = np.array([firm, firm * 10 ** rng.uniform(-1, 1), 0.1 * firm * 10 ** rng.uniform(-1, 0)])
    changes = {
        "grips.model": "compliant",
        "grips.stiffness": tuple(stiffness.tolist()),
        "grips.damping": tuple((rng.uniform(0, 1) * np.sqrt(stiffness)).tolist()),
        "grips.measured_at": "arms" if rng.random() < 0.8 else "payload",
    }
    held = scenario.replace({"simulation.integrator": "auto"}).replace(changes)
    try:
        World(held)
    except ScenarioError:  # As in `with_mass_change`.
        changes = {"payload.element_count": 2, "payload.mode_count": None, "payload.bending_stiffness": 100.0}
        held = held.replace({**changes, "payload.damping": {"kind": "nodal", "coefficient": 0.1}})
    return held


def judge(
    seed: int,
    longest_reference: float = LONGEST_REFERENCE,
    references: Sequence[float] = REFERENCES,
    wide: bool = False,
    axial: bool = False,
    joints: bool = False,
    mass: bool = False,
    grips: bool = False,
) -> Judgement:
    """Compare a run of a random scenario with one of finer steps; with `axial`, its beam feels the force along itself.

    `wide`, `joints`, `mass` and `grips` choose scenarios of `wide_scenario`, `with_joints`, `with_mass_change` and `with_grips`.
    `references`: some of `REFERENCES`.
    """
    scenario = wide_scenario(seed) if wide else random_scenario(seed)
    if joints:
        scenario = with_joints(scenario, seed)
    if mass:
        scenario = with_mass_change(scenario, seed)
    if grips:
        scenario = with_grips(scenario, seed)
    if axial:
        scenario = scenario.replace({"payload.axial_load": "first-order"})
    world = World(scenario, known=[started(scenario).assembly])
    finer = 16 if world.assembly.watch.disturbed else 4
    limited = scenario.controller.torque_limit is not None or any(scenario.joints.motor.stall_torque)
    limited = limited and scenario.controller.control_period is None
    step = min(world.step, LIMITED_STEP if limited else math.inf) / finer
    pace = seconds_per_second(world.assembly, max(step, SHORTEST_STEP))
    ticks = max(20, int(min(DURATION, longest_reference / pace) / world.tick_period))
    run = world.run(ticks)
    for shorter in references:
        # Nothing checks a given step beforehand: its errors may grow where those of another step do not.
        reference = World(scenario.replace({"simulation.step": max(step / shorter, SHORTEST_STEP * shorter)}))
        exact = reference.run(ticks)
        if not reference.accuracy_warning:
            break
    warning, of_reference = (each.accuracy_warning.partition(OF_LOSS)[0].rstrip() for each in (world, reference))
    complaints = []
    both = min(len(run.time), len(exact.time))
    if world.status.failed and not reference.status.failed:
        complaints.append(f"stopped alone: {world.status.text}")
    forces = [force_of(scenario, samples)[:both] for samples in (run, exact)]
    peak = float(np.abs(forces[1]).max())
    force = float(np.abs(forces[0] - forces[1]).max()) / (peak or 1.0)
    pose = float(np.abs(run.pose[:both] - exact.pose[:both]).max())
    if not warning and not reference.status.failed and force > FORCE_BOUND:
        complaints.append(f"force off by {force:.1e} of its peak")
    if not warning and not reference.status.failed and pose > POSE_BOUND:
        complaints.append(f"pose off by {pose:.1e} m or rad")
    said, unknown = (stated_sizes(each) for each in (warning, of_reference))
    for what, size in (("pose", pose), ("force", force)):
        if size > EXCEEDED * (said[what] + unknown[what] * bool(of_reference)):
            complaints.append(f"{what} off by {size:.1e}, more than is said")
    lost = exact.dissipated_energy[:both]
    loss = float(np.abs(run.dissipated_energy[:both] - lost).max()) / max(float(lost[-1]), LEAST_LOSS)
    if not world.accuracy_warning and not of_reference and loss > EXCEEDED * LOSS_BOUND:
        complaints.append(f"dissipated energy off by {loss:.1e} of it")
    beam, law = scenario.payload, scenario.controller
    text = (
        f"{beam.boundary} n={beam.element_count} EI={beam.bending_stiffness:.3g} ρ={beam.linear_density:.2g} "
        f"{beam.damping.model_dump()} {law.kind} T_c={law.control_period} step {world.step:.3g} ticks {ticks} "
        f"pose {pose:.1e} force {force:.1e} "
        f"{warning and 'inaccurate'} {world.status.text[:40]}"
    )
    return Judgement(text, tuple(complaints), world)


def force_of(scenario: Scenario, samples: Samples) -> np.ndarray:
    """The internal forces, (N, arms, 3); for a single arm, which has none, the moving force, (N, 3)."""
    return samples.moving_force if len(scenario.arms) == 1 else samples.internal_force


def pace_after_the_start(world: World) -> tuple[float, str]:
    """Processor time per simulated time of a new world, after the finer steps of its start, and its pace warning."""
    later = World(world.scenario, known=[world.assembly])
    later.advance_rows(SHORT_STEPS)
    begun = time.thread_time()
    ticks = len(later.advance_rows(TIMED))
    return (time.thread_time() - begun) / (max(ticks, 1) * later.tick_period), later.pace_warning


def main() -> None:
    """Judge scenarios `first` to `last` (from 0 on if one number is given) and print the judgements."""
    asked = argparse.ArgumentParser()
    asked.add_argument("numbers", type=int, nargs="*", default=[20])
    asked.add_argument("--wide", action="store_true")
    asked.add_argument("--axial", action="store_true")
    asked.add_argument("--joints", action="store_true")
    asked.add_argument("--mass", action="store_true")
    asked.add_argument("--grips", action="store_true")
    asked.add_argument("--seconds", type=float, default=LONGEST_REFERENCE)
    given = asked.parse_args()
    first, last = (0, given.numbers[0]) if len(given.numbers) == 1 else given.numbers[:2]
    bad = 0
    for seed in range(first, last):
        judged = judge(seed, given.seconds, REFERENCES, given.wide, given.axial, given.joints, given.mass, given.grips)
        bad += bool(judged.complaints)
        took, warned = pace_after_the_start(judged.world)
        crawls = ["slower than real time, unannounced"] if took > 1 and not warned else []
        mark = " | ".join([*judged.complaints, *crawls])
        print(f"{seed}: {mark or 'fine'}   [{judged.text} {took:.2g} s/s {warned and 'announced'}]", flush=True)
    print(f"{last - first} scenarios, {bad} with complaints")


if __name__ == "__main__":
    main()
