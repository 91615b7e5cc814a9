"""The controller's model of the axial force: how it changes the believed plant, and how it improves control."""

import numpy as np
import pytest

from flexlab.analysis.modes import modes
from flexlab.control.observers.believed_plant import believed_plant
from flexlab.physics.axial_load import buckling_load
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, Tap
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

FORCE = 35.0
"""N, 70 % of the buckling load."""


def squeezed(preset: str, belief: str, **changes: object) -> Scenario:
    return load_preset(preset).replace(
        {
            "payload.bending_stiffness": 1.27,
            "payload.axial_load": "first-order",
            "controller.wanted_internal_force": FORCE,
            "controller.model.axial_load": belief,
            "trajectory.amplitude": (0.0, 0.0, 0.0),
            "initial.pose_rate": (0.0, 0.0, 0.0),
            **{path.replace("__", "."): value for path, value in changes.items()},
        }
    )


def test_a_squeeze_softens_the_believed_beam() -> None:
    gauges = (-0.25, 0.25)
    plain, told = (believed_plant(squeezed("lqr", belief), 2, gauges) for belief in ("none", "first-order"))
    np.testing.assert_array_equal(plain.stiffness, np.diag(plain.omega**2))
    left = 1 - FORCE / buckling_load(0.5, 1.27, "pinned-pinned")
    assert told.stiffness[0, 0] == pytest.approx(left * plain.omega[0] ** 2, rel=0.02)
    np.testing.assert_array_equal(told.stiffness, told.stiffness.T)


def test_composite_damps_a_squeezed_beam_better_if_it_knows_of_the_squeeze() -> None:
    """1.5 s after the tap, less than a tenth of the vibration without the belief is left."""
    late = {}
    for belief in ("none", "first-order"):
        run = simulate(squeezed("composite", belief), 3.0, 0.001, ((0.5, Tap(0.0, (0.0, 0.02))),))
        late[belief] = np.abs(run.vibration[run.time > 2.0]).max()
    assert late["first-order"] < 0.1 * late["none"]


def test_the_slowest_pole_of_lqr_is_faster_with_the_belief() -> None:
    slow, fast = (modes(squeezed("lqr", belief)).growth for belief in ("none", "first-order"))
    assert fast < 1.2 * slow < 0


def test_the_belief_about_a_turned_beam_follows_gravity_in_motion() -> None:
    """The weight of a turned beam presses along it."""
    turned = squeezed("lqr", "first-order", trajectory__center=(0.0, 0.75, 0.4))
    begun = turned.replace({"gravity": 9.81})
    assert believed_plant(begun, 1, (0.0,)).stiffness != believed_plant(turned, 1, (0.0,)).stiffness
    world = World(turned)
    world.advance(200)
    before = world.system.control.gains.tobytes()
    assert not world.apply(ChangeScenario({"gravity": 9.81})), "the run goes on"
    assert len(world.advance(200)) == 200, world.status.text
    assert before != world.system.control.gains.tobytes() == World(begun).system.control.gains.tobytes()
