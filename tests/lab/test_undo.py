"""Undo is complete: from any scenario to any other and back again."""

import time
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lab_page import wait_until

from flexlab.lab import changes
from flexlab.lab.changes import Settings, Undo
from flexlab.lab.lab_state import LabState
from flexlab.physics.plant import Hand
from flexlab.presets import load_preset, preset_names
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import changes_towards
from flexlab.sim.commands import ChangeScenario, Pause, Play, Pull, Reset, SetSpeed
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Origin
from flexlab.sim.world import World

PAPER = Scenario()
NAMES = preset_names()


def with_stiffness(value: float) -> Settings:
    return Settings(PAPER.replace({"payload.bending_stiffness": value}), "paper", PAPER)


@settings(max_examples=60)
@given(st.sampled_from(NAMES), st.sampled_from(NAMES))
def test_changes_lead_from_any_preset_to_any_other(start: str, goal: str) -> None:
    present, wanted = load_preset(start), load_preset(goal)
    assert present.replace(changes_towards(present, wanted)) == wanted


def test_a_new_kind_is_changed_before_its_fields() -> None:
    wanted = PAPER.replace(
        {"controller.kind": "pd", "controller.position_gain": 5000.0, "payload.damping.kind": "modal"}
    )
    changes = changes_towards(PAPER, wanted)
    assert PAPER.replace(changes) == wanted
    names = list(changes)
    assert names.index("controller.kind") < names.index("controller.position_gain")
    assert "controller.boundary_layer" not in changes


def test_undo_and_redo_pass_through_the_same_settings() -> None:
    history = Undo()
    steps = [with_stiffness(value) for value in (100.0, 50.0, 20.0)]
    history.note(steps[0], "a")
    history.note(steps[1], "b")
    assert history.back(steps[2]) == steps[1]
    assert history.back(steps[1]) == steps[0]
    assert history.back(steps[0]) is None
    assert history.forward(steps[0]) == steps[1]
    assert history.forward(steps[1]) == steps[2]
    assert history.forward(steps[2]) is None


def test_one_gesture_is_one_step_of_undo() -> None:
    history = Undo()
    for value in (100.0, 90.0, 80.0):
        history.note(with_stiffness(value), ("payload.bending_stiffness",))
    assert history.back(with_stiffness(70.0)) == with_stiffness(100.0)
    assert history.back(with_stiffness(100.0)) is None
    history.note(with_stiffness(100.0), ("payload.bending_stiffness",))
    assert history.back(with_stiffness(60.0)) == with_stiffness(100.0), "an undo ends the gesture"


def test_after_a_new_change_nothing_can_be_redone() -> None:
    history = Undo()
    history.note(with_stiffness(100.0), "a")
    assert history.back(with_stiffness(50.0)) == with_stiffness(100.0)
    history.note(with_stiffness(100.0), "b")
    assert history.forward(with_stiffness(10.0)) is None


def test_undo_skips_a_step_without_effect() -> None:
    history = Undo()
    history.note(with_stiffness(100.0), "a")
    history.note(with_stiffness(50.0), "b")
    assert history.back(with_stiffness(50.0)) == with_stiffness(100.0)


def test_continuing_a_run_is_a_step_even_with_equal_settings() -> None:
    history, before = Undo(), with_stiffness(100.0)
    origin = Origin("earlier", 1.5, World(PAPER).state())
    after = replace(before, origin=origin)
    history.note(before)
    assert history.back(after) == before
    assert history.forward(before) == after


def test_the_history_of_undo_is_bounded() -> None:
    history = Undo()
    for value in range(3 * changes.LONGEST_HISTORY):
        history.note(with_stiffness(1.0 + value), value)
    steps, present = 0, with_stiffness(0.5)
    while (earlier := history.back(present)) is not None:
        present, steps = earlier, steps + 1
    assert steps == changes.LONGEST_HISTORY


def test_a_pull_that_lasts_beyond_a_change_of_the_mesh_can_be_let_go() -> None:
    runner = Runner(load_preset("paper"), "paper", clock=lambda: 0.0)
    lab_state = LabState(runner)

    def is_pulled() -> bool:
        runner.frame()
        lab_state.settle(runner.snapshot)
        return bool(Hand(*runner.checkpoint(0.0).state.pull).stiffness)

    lab_state.pull(Pull(0.0, (0.0, 1.5), 500.0))
    assert is_pulled()
    lab_state.change({"payload.element_count": 6})
    wait_until(lambda: is_pulled() and runner.snapshot.run_number == 2, "the new mesh")
    assert lab_state.pulled is not None, "its arrow stays"
    lab_state.pull(None)
    assert not is_pulled()
    lab_state.pull(Pull(0.0, (0.0, 1.5), 500.0))
    assert is_pulled()
    runner.submit(Reset())
    assert not is_pulled()
    assert lab_state.pulled is None
    runner.stop()


def test_a_change_before_a_preset_was_saved_is_undone_in_the_same_run() -> None:
    runner = Runner(PAPER, "paper", playing=False)
    lab_state = LabState(runner)
    for stiffness in (50.0, 20.0):
        lab_state.change({"payload.bending_stiffness": stiffness})
        lab_state.change({"gravity": 1.0 / stiffness})
    mine = lab_state.intended.replace({"title": "Mine"})
    lab_state.saved(mine, "mine")
    assert not lab_state.changed
    for _ in range(4):
        lab_state.undo()
        runner.frame()
        lab_state.settle(runner.snapshot)
    assert lab_state.intended == PAPER
    assert (lab_state.name, lab_state.baseline) == ("mine", mine)
    for _ in range(4):
        lab_state.redo()
        runner.frame()
    assert not lab_state.changed
    assert runner.snapshot.run_number == 1
    assert runner.snapshot.scenario.payload.bending_stiffness == 20.0


def test_a_continued_run_lets_go_of_what_was_pulled() -> None:
    world = World(load_preset("paper"))
    world.apply(Pull(0.2, (-0.9, 0.8), 300.0, (1, 2)))
    world.advance(100)
    origin = Origin("earlier", world.time, world.state())
    runner = Runner(world.scenario, "earlier", clock=lambda: 0.0, origin=origin)
    lab_state = LabState(runner, origin)
    runner.frame()
    assert runner.snapshot.events[-1].text == "Let go of link 2 of the left arm"
    assert lab_state.pulled is None
    lab_state.load(world.scenario, "earlier", origin)
    runner.frame()
    assert [event.text for event in runner.snapshot.events][-1] == "Let go of link 2 of the left arm"
    assert runner.snapshot.latest.time[0] == pytest.approx(0.1)


def test_a_requested_change_is_kept_until_the_engine_has_answered() -> None:
    """However long that takes, the controls do not jump back meanwhile, and the change can be undone."""
    runner = Runner(PAPER, "paper", playing=False)
    lab_state = LabState(runner)
    lab_state.change({"payload.bending_stiffness": 50.0})
    time.sleep(1.1)
    lab_state.settle(runner.snapshot)
    assert lab_state.intended.payload.bending_stiffness == 50.0
    wait_until(lambda: runner.frame() or runner.snapshot.scenario != PAPER, "the change is carried out")
    lab_state.settle(runner.snapshot)
    lab_state.undo()
    assert lab_state.intended == PAPER
    before = runner.snapshot
    runner.frame()
    lab_state.settle(before)
    assert lab_state.intended == PAPER, "an older snapshot knows nothing of the undo"


def test_changes_by_somebody_else_are_followed() -> None:
    runner = Runner(PAPER, "paper", playing=False)
    lab_state = LabState(runner)
    runner.submit(ChangeScenario({"gravity": 3.0}))
    runner.frame()
    lab_state.settle(runner.snapshot)
    assert lab_state.intended.gravity == 3.0


def test_requests_in_quick_succession_build_on_one_another() -> None:
    """Two keys may come within one frame of the engine, before it has answered either."""
    runner = Runner(PAPER, "paper", playing=False)
    lab_state = LabState(runner)
    for expected in (True, False, True):
        lab_state.submit(Pause() if lab_state.playing else Play())
        assert lab_state.playing is expected
    for expected in (0.5, 0.25):
        lab_state.submit(SetSpeed(lab_state.target_speed / 2))
        assert lab_state.target_speed == expected
    runner.frame()
    assert runner.snapshot.playing
    assert lab_state.playing
    assert runner.snapshot.target_speed == lab_state.target_speed == 0.25
