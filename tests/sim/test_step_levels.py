"""The automatic step adapts during the run, by the state at each tick alone."""

import re

import numpy as np
import pytest

from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.sim.step_size import STABLE_COUPLING
from flexlab.sim.world import World

FAST_ADAPTATION = {
    "trajectory.amplitude": (0.4, 0.4, 0.2),
    "trajectory.frequency": (3.0, 3.0, 3.0),
    "controller.adaptation": (0.03, 0.03, 0.03),
}
"""b̂ grows as much in hundredths of a second as with the paper's law in minutes."""


def test_the_step_shrinks_as_the_bound_estimates_grow():
    world = World(load_preset("paper").replace(FAST_ADAPTATION))
    before = world.step
    samples = world.run(40)
    assert world.status == "running"
    assert world.step < before / 16
    fine = World(load_preset("paper").replace(FAST_ADAPTATION | {"simulation.step": 2e-6})).run(40)
    assert np.abs(samples.pose - fine.pose).max() < 1e-8


def test_the_size_of_blocks_changes_no_bit_where_the_step_changes():
    scenario = load_preset("paper").replace(FAST_ADAPTATION)
    whole, world = World(scenario).run(30), World(scenario)
    parts = [world.advance(ticks) for ticks in (1, 6, 2, 13, 8)]
    assert np.array_equal(np.concatenate([part.pose for part in parts]), whole.pose[1:])


def test_a_stiff_beam_in_one_arm_keeps_a_stable_step():
    scenario = load_preset("single-arm").replace({"payload.bending_stiffness": 2e7})
    samples = World(scenario).run(10)
    fine = World(scenario.replace({"simulation.step": 5e-7})).run(10)
    assert np.abs(samples.pose - fine.pose).max() < 1e-8


@pytest.mark.parametrize("integrator", ["rk4", "etdrk4"])
def test_a_scenario_that_needs_steps_below_the_shortest_is_refused(integrator: str):
    changes = {"simulation.integrator": integrator, "controller.feedback_gain": 1e6, "payload.element_count": 64}
    changes |= {"payload.damping": {"kind": "stiffness", "coefficient": 0.1}, "payload.bending_stiffness": 1e6}
    if integrator == "etdrk4":
        changes |= {"left_arm.link_mass": (0.01, 0.01, 0.01), "right_arm.link_mass": (0.01, 0.01, 0.01)}
    with pytest.raises(ScenarioError, match=r"would need a step of .* below the 10⁻⁷ s"):
        World(load_preset("paper").replace(changes))


@pytest.mark.parametrize("accuracy", [1e-10, 1e-8, 1e-6, 1e-4])
@pytest.mark.parametrize(
    ("preset", "elements", "stiffness", "damping"),
    [
        ("paper", 16, 1e5, {"kind": "nodal", "coefficient": 0.6}),
        ("paper", 16, 1e5, {"kind": "stiffness", "coefficient": 1e-4}),
        ("paper", 24, 1e4, {"kind": "modal", "ratio": 0.05}),
        ("paper", 8, 1e6, {"kind": "modal", "ratio": 0.0}),
        ("single-arm", 8, 1e4, {"kind": "nodal", "coefficient": 0.1}),
    ],
)
def test_however_coarse_the_accuracy_the_step_stays_stable(preset, elements, stiffness, damping, accuracy):
    """Modes that fade at once used to be given up to six times the longest stable step, and were inaccurate."""
    changes = {"payload.element_count": elements, "payload.bending_stiffness": stiffness, "payload.damping": damping}
    world = World(load_preset(preset).replace({**changes, "simulation.accuracy": accuracy}))
    assert world.assembly.levels.step * world.assembly.rates.coupling <= STABLE_COUPLING
    world.advance(60)
    assert not world.status.failed


@pytest.mark.parametrize("stiffness", [100.0, 110.0, 120.0])
def test_the_longest_stable_step_that_a_refusal_names_is_accepted(stiffness: float) -> None:
    """It was rounded up for some beams, and refused with its own value as the longest one."""
    rk4 = load_preset("paper").replace({"simulation.integrator": "rk4", "payload.bending_stiffness": stiffness})
    with pytest.raises(ScenarioError) as refusal:
        World(rk4.replace({"simulation.step": 0.01}))
    named = re.findall(r"at most ([\d.]+) s\.", str(refusal.value))
    assert World(rk4.replace({"simulation.step": float(named[0])})).integrator == "rk4"
