"""Runs that go on from an earlier one: state, time, name and texts."""

import numpy as np
import pytest

from flexlab.errors import StudyError
from flexlab.presets import load_preset
from flexlab.sim.commands import LoadScenario, Reset
from flexlab.sim.samples import Origin
from flexlab.sim.world import World


@pytest.fixture(params=["paper", "fast-adaptation"])
def earlier(request) -> World:
    """A world at t = 0.25 s, with continuous control, or with sampled control and torques on their way."""
    world = World(load_preset(request.param))
    world.advance(250)
    return world


def origin_of(world: World) -> Origin:
    return Origin("2026-01-01T00-00-00-earlier", world.time, world.state())


def test_a_lab_that_starts_from_an_earlier_run_gives_the_same_samples(live, earlier: World):
    stage = live(earlier.scenario, origin=origin_of(earlier))
    assert stage.runner.snapshot.latest.time[0] == 0.25
    stage.play(0.3)
    pose = stage.keeper.signal("pose")
    assert np.array_equal(pose, earlier.run(len(pose) - 1).pose)
    assert stage.keeper.signal("time")[0] == 0.25
    assert stage.runner.snapshot.events[0].text == "Go on from 2026-01-01T00-00-00-earlier at t = 0.250 s"


def test_a_running_lab_can_go_on_from_an_earlier_run_and_reset_begins_at_zero(live, earlier: World):
    stage = live()
    stage.play(0.1)
    stage.frame(0.0, LoadScenario(earlier.scenario, "earlier", origin_of(earlier)))
    snapshot = stage.play(0.2)
    keeper = stage.keeper
    assert (snapshot.run_number, snapshot.name) == (2, "earlier")
    assert keeper.runs[1][3].tick == 250
    assert np.array_equal(keeper.signal("pose", 2), earlier.run(len(keeper.signal("pose", 2)) - 1).pose)
    said = [(number, event.time) for number, event in keeper.events if event.text.startswith("Go on from")]
    assert said == [(1, keeper.signal("time", 1)[-1]), (2, 0.25)]
    assert stage.frame(0.0, Reset()).latest.time[0] == 0.0


def test_a_state_of_another_structure_is_refused(live, earlier: World):
    other = World(load_preset("paper").replace({"payload.element_count": 5}))
    with pytest.raises(StudyError, match=r"does not fit its scenario: y has the shape"):
        earlier.restore(other.state())
    assert earlier.time == 0.25
    stage = live()
    snapshot = stage.frame(0.01, LoadScenario(earlier.scenario, "earlier", origin_of(other)))
    assert snapshot.run_number == 1
    assert snapshot.events[-1].level == "error"
