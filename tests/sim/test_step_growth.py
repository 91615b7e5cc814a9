"""A beam that nothing damps, in arms that give way: which steps make its modes ring louder without end."""

import math

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.step_growth import STEADY_GROWTH, growth_rate
from flexlab.sim.world import World

LOUD = 1e-3 / 90
"""s: a step with which two modes of the beam below push one another."""


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
    return growth_rate(world.assembly.system, world.assembly.beam, world.assembly.rates, step)


def test_growth_is_what_a_run_shows():
    world = World(undamped(5e3, LOUD))
    world.run(40)
    louder = [np.abs(world.run(10).moving_force).max() for _ in range(3)]
    seen = math.log(louder[2] / louder[0]) / 0.02
    assert seen == pytest.approx(growth(world, LOUD), rel=0.2)
    assert seen > 100


def test_a_steady_step_does_not_grow():
    world = World(undamped(5e3, LOUD / 4))
    assert abs(growth(world, LOUD / 4)) < STEADY_GROWTH
    early = np.abs(world.run(200).moving_force).max()
    world.run(1000)
    assert np.abs(world.run(200).moving_force).max() < 2 * early


@pytest.mark.parametrize("stiffness", [2721.0, 30079.0])
def test_a_step_that_nobody_gave_is_a_steady_one(stiffness: float):
    """The step that accuracy asks for makes errors grow a hundred million times in half a second: a shorter one is taken."""
    world = World(undamped(stiffness))
    asked, taken = world.assembly.asked, world.assembly.steps
    assert growth(world, asked.step) > 50
    assert growth(world, taken.step) < 1
    assert asked.step / 1.2 < taken.step < asked.step
    early = np.abs(world.run(300).moving_force).max()
    assert np.abs(world.run(300).moving_force).max() < 2 * early
    assert not world.status.failed


def test_a_gain_does_not_ask_again_and_changes_no_step():
    world = World(undamped(2721.0))
    before = world.assembly.steps
    world.apply(ChangeScenario({"controller.feedback_gain": 210.0}))
    assert world.assembly.steps is before
    assert World(world.scenario).assembly.steps == before


def test_what_grew_is_named():
    world = World(undamped(5e3, LOUD))
    world.run(1000)
    assert world.status.failed
    assert "errors of the steps grew in modes that nothing damps" in world.status.text
    assert "payload.damping" in world.status.text


def test_a_path_out_of_reach_is_said_as_ever():
    world = World(undamped(1e5).replace({"trajectory.center": (0.0, 3.0, 0.0)}))
    assert world.status == "unreachable"
