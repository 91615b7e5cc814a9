"""A beam with overdamped modes in an arm lighter than the mass that they move: errors must not grow from step to step."""

import numpy as np
import pytest

from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.accuracy import CHECKED_TICKS
from flexlab.sim.step_size import SHORTEST_CHOSEN
from flexlab.sim.world import World

TICKS = 40
"""Ticks of a run: more than those with shorter steps after a start."""


def stiff_beam(n: int, stiffness: float, damping: float, density: float) -> Scenario:
    return load_preset("single-arm").replace(
        {
            "payload.element_count": n,
            "payload.bending_stiffness": stiffness,
            "payload.linear_density": density,
            "payload.damping": {"kind": "stiffness", "coefficient": damping},
        }
    )


@pytest.mark.parametrize(
    ("n", "stiffness", "damping", "density"),
    [(2, 8.6e5, 5.8e-4, 6.0), (4, 9.2e5, 8.2e-4, 8.0), (8, 7.4e4, 1.4e-3, 3.5), (8, 1.1e5, 1.57e-3, 9.0)],
)
def test_overdamped_modes_do_not_blow_up_in_a_light_arm(n: int, stiffness: float, damping: float, density: float):
    world = World(stiff_beam(n, stiffness, damping, density))
    run = world.run(TICKS)
    assert not world.status.failed, world.status.text
    assert len(run.time) == TICKS + 1


@pytest.mark.parametrize(
    ("n", "stiffness", "damping", "density"), [(16, 3.1e5, 1.7e-3, 6.0), (32, 1.4e6, 7.4e-4, 10.0)]
)
def test_a_beam_that_no_step_could_follow_is_refused(n: int, stiffness: float, damping: float, density: float):
    with pytest.raises(ScenarioError, match="less damped beam, fewer elements, or heavier links"):
        World(stiff_beam(n, stiffness, damping, density))


def test_a_given_step_that_is_too_long_for_the_modes_is_named_as_the_cause():
    world = World(stiff_beam(8, 1.1e5, 1.57e-3, 9.0).replace({"simulation.step": 1e-5}))
    world.run(TICKS)
    assert world.status.failed
    assert "too long for the modes of this beam" in world.status.text
    assert "simulation.step = null" in world.status.text


def test_ticks_at_the_finest_level_are_also_repeated_at_a_finer_one():
    world = World(stiff_beam(8, 7.4e4, 1.4e-3, 3.5))
    finest = world.assembly.watch.most
    assert finest == 3
    world.run(12)
    assert world.step == pytest.approx(world.assembly.steps.step / 2**finest)
    assert world._motion.estimate.checked == CHECKED_TICKS[4]


def test_generalized_alpha_takes_a_beam_that_the_automatic_integrator_refuses():
    scenario = stiff_beam(16, 3.1e5, 1.7e-3, 6.0).replace({"simulation.integrator": "generalized-alpha"})
    world = World(scenario)
    world.run(5)
    assert not world.status.failed


def test_a_slow_run_says_what_makes_it_slow():
    said = World(stiff_beam(8, 1.1e5, 1.57e-3, 9.0)).pace_warning
    assert "strongly damped and heavy for these arms" in said
    assert "less damping" in said


@pytest.mark.parametrize("damping", [3e-4, 1e-3])
def test_overdamped_motion_is_right_or_called_inaccurate(damping: float):
    scenario = stiff_beam(8, 5e4, damping, 4.0)
    world = World(scenario)
    finer = World(scenario.replace({"simulation.step": max(world.step / 16, SHORTEST_CHOSEN)}))
    run, exact = world.run(TICKS), finer.run(TICKS)
    error = np.abs(run.moving_force - exact.moving_force).max()
    assert world.accuracy_warning or error < 1e-4 * np.abs(exact.moving_force).max()
