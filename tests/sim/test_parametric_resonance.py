"""Steps that make the modes of an undamped beam, in arms that give way, ring ever louder."""

import math

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.parametric_resonance import STEADY_GROWTH, growth_rate
from flexlab.sim.step_size import Count
from flexlab.sim.world import World

LOUD = 1e-3 / 90
"""Step, s, with which two modes of the beam below excite one another."""


def undamped(stiffness: float, step: float | None = None) -> Scenario:
    return load_preset("single-arm").replace(
        {
            "payload.element_count": 16,
            "payload.bending_stiffness": stiffness,
            "payload.linear_density": 4.0,
            "payload.damping": {"kind": "modal", "ratio": 0.0},
            "simulation.step": step,
        }
    )


def growth(world: World, step: float) -> float:
    assembly = world.assembly
    pose = np.array(world.scenario.trajectory.middle)
    return growth_rate(assembly.system, assembly.beam, assembly.rates, pose, step)


def test_the_computed_growth_is_what_a_run_shows():
    world = World(undamped(5e3, LOUD))
    world.run(40)
    louder = [np.abs(world.run(10).moving_force).max() for _ in range(3)]
    seen = math.log(louder[2] / louder[0]) / 0.02
    assert seen == pytest.approx(growth(world, LOUD), rel=0.2)
    assert seen > 100


def test_a_run_with_a_steady_step_does_not_grow():
    world = World(undamped(5e3, LOUD / 4))
    assert abs(growth(world, LOUD / 4)) < STEADY_GROWTH
    early = np.abs(world.run(200).moving_force).max()
    world.run(1000)
    assert np.abs(world.run(200).moving_force).max() < 2 * early


@pytest.mark.parametrize(("stiffness", "ratio"), [(2721.0, 0.0), (30079.0, 0.0), (2721.0, 1e-5), (2721.0, 1e-4)])
def test_the_automatic_step_is_a_steady_one(stiffness: float, ratio: float):
    """The step that accuracy asks for would make errors grow 10⁸ times in half a second; a shorter one is taken."""
    world = World(undamped(stiffness).replace({"payload.damping.ratio": ratio}))
    asked, taken = world.assembly.asked, (world.assembly.unrefined or world.assembly).steps
    assert growth(world, world.step) <= STEADY_GROWTH
    assert growth(world, asked.step) > 15
    assert growth(world, taken.step) <= STEADY_GROWTH
    assert asked.step / 3.1 < taken.step < asked.step
    early = np.abs(world.run(200).moving_force).max()
    world.run(1000)
    assert np.abs(world.run(200).moving_force).max() < 2 * early
    assert not world.status.failed


def test_damping_stronger_than_any_growth_leaves_the_step_alone():
    world = World(undamped(2721.0).replace({"payload.damping.ratio": 0.02}))
    assert world.assembly.steps is world.assembly.asked


def law_bound(gain: float) -> Scenario:
    """A scenario whose law bounds the step: two gains ask for the same number of steps, but not for the same step."""
    return undamped(2e4).replace({"controller.feedback_gain": gain})


def test_steps_do_not_depend_on_earlier_assemblies():
    gain = 3364.858933419802
    world = World(law_bound(gain))
    world.apply(ChangeScenario({"controller.feedback_gain": 0.999 * gain}))
    fresh = World(law_bound(0.999 * gain))
    assert world.assembly.asked == fresh.assembly.asked
    assert world.assembly.steps == fresh.assembly.steps


@pytest.mark.parametrize("before", [{"simulation.step": 1e-5}, {"simulation.integrator": "generalized-alpha"}])
def test_given_steps_and_those_of_another_integrator_do_not_count_as_steady(before: dict):
    world = World(undamped(2721.0).replace(before))
    world.apply(ChangeScenario({"simulation.step": None, "simulation.integrator": "auto"}))
    assert world.assembly.steps == World(undamped(2721.0)).assembly.steps


def test_changes_that_do_not_affect_growth_keep_the_tested_steps():
    def steady(world: World) -> Count:
        """The steps that were tested, before they are halved for the run's beginning."""
        return (world.assembly.unrefined or world.assembly).steps

    world = World(undamped(2721.0))
    before = steady(world)
    for changes in ({"controller.feedback_gain": 210.0}, {"trajectory.amplitude": (0.1, 0.1, 0.1)}, {"gravity": 1.0}):
        world.apply(ChangeScenario(changes))
        assert steady(world) is before
        assert steady(World(world.scenario)) == before


def test_a_slow_run_says_what_makes_it_slow():
    said = World(undamped(30079.0)).pace_warning
    assert "nearly undamped modes need steps of" in said
    assert "payload.damping" in said


def test_a_run_that_high_gains_blow_up_at_once_is_not_blamed_on_growth():
    world = World(undamped(5e3, 1e-5).replace({"controller.feedback_gain": 1e5}))
    world.run(20)
    assert world.status.failed
    assert "nothing damps" not in world.status.text
    assert "lower gains" in world.status.text


def test_a_run_that_growth_ends_names_the_undamped_modes():
    world = World(undamped(5e3, LOUD))
    world.run(1000)
    assert world.status.failed
    assert "errors of the steps grew in nearly undamped modes" in world.status.text
    assert "payload.damping" in world.status.text


def test_an_unreachable_path_is_still_reported():
    world = World(undamped(1e5).replace({"trajectory.center": (0.0, 3.0, 0.0)}))
    assert world.status == "unreachable"
