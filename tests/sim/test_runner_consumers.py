"""Consumers get every sample once, in order, from the first instant on, run by run."""

import numpy as np

from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario, LoadScenario, Pause, Play, Reset, SetSpeed, StepOnce
from flexlab.sim.world import World


def ticks(keeper, run_number: int) -> np.ndarray:
    return np.rint(keeper.signal("time", run_number) / 0.001).astype(int)


def test_consumers_get_every_sample_exactly_once_and_in_order(live):
    """With jittery frames, dropped backlog, pause, steps and speed changes, samples are 0, 1, 2, … without gap or repetition."""
    stage, rng = live(), np.random.default_rng(1)
    for k in range(150):
        extra = {20: [SetSpeed(4.0)], 50: [Pause()], 60: [StepOnce(7)], 70: [Play()], 90: [SetSpeed(0.01)]}.get(k, [])
        stage.frame(3.0 if k == 40 else float(rng.uniform(0, 0.06)), *extra)
    found = ticks(stage.keeper, 1)
    assert np.array_equal(found, np.arange(len(found)))
    assert len(found) > 2000
    assert found[-1] == round(float(stage.runner.snapshot.latest.time[0]) / 0.001)


def test_blocks_are_what_a_headless_world_computes(live):
    """The runner hands out the world's samples unchanged."""
    stage = live()
    stage.play(0.5)
    pose = stage.keeper.signal("pose")
    assert np.array_equal(pose, World(load_preset("paper")).run(len(pose) - 1).pose)


def test_each_run_begins_ends_and_starts_with_its_first_sample(live):
    """After reset, preset or new structure: begin, samples from the first instant, end with a status; run numbers count up."""
    stage = live()
    stage.play(0.1)
    stage.frame(0.01, Reset())
    stage.play(0.1)
    stage.frame(0.01, LoadScenario(load_preset("soft-beam"), "soft-beam"))
    stage.play(0.1)
    stage.frame(0.01, ChangeScenario({"payload.element_count": 5}))
    stage.play(0.1)
    stage.runner.stop()
    keeper = stage.keeper
    assert [number for number, *_ in keeper.runs] == [1, 2, 3, 4]
    assert [name for _, name, *_ in keeper.runs] == ["test", "test", "soft-beam", "soft-beam"]
    assert [number for number, _ in keeper.ends] == [1, 2, 3, 4]
    assert all(status == "finished" for _, status in keeper.ends)
    for number in (1, 2, 3):
        found = ticks(keeper, number)
        assert np.array_equal(found, np.arange(len(found)))
    # Time goes on with the new mesh: its first sample is at the instant at which the old run ended, in the new coordinates.
    assert ticks(keeper, 4)[0] == ticks(keeper, 3)[-1]
    assert np.array_equal(np.diff(ticks(keeper, 4)), np.ones(len(ticks(keeper, 4)) - 1))
    assert keeper.signal("beam_coordinates", 4).shape[1] == 10
    assert keeper.runs[3][3].tick == ticks(keeper, 4)[0]


def test_a_run_can_be_replayed_from_the_state_that_its_consumer_was_given(live):
    """`begin_run` passes scenario and state: restoring them gives the same bits, also for a run that goes on."""
    stage = live()
    stage.play(0.2)
    stage.frame(0.01, ChangeScenario({"payload.element_count": 4}))
    stage.play(0.2)
    _, _, scenario, start = stage.keeper.runs[1]
    world = World(scenario)
    world.restore(start)
    pose = stage.keeper.signal("pose", 2)
    assert np.array_equal(world.run(len(pose) - 1).pose, pose)


def test_coordinates_with_another_meaning_make_a_new_run(live):
    """clamped-pinned → pinned-clamped has as many coordinates, but others: a recording may not go on under the old names."""
    stage = live(load_preset("paper").replace({"payload.element_count": 3, "payload.boundary": "clamped-pinned"}))
    stage.play(0.1)
    snapshot = stage.frame(0.01, ChangeScenario({"payload.boundary": "pinned-clamped"}))
    assert snapshot.run_number == 2


def test_dropped_samples_are_counted_until_the_next_run(live):
    """The snapshot counts the samples that a consumer reports as lost."""
    stage = live()
    stage.play(0.1)
    assert stage.runner.snapshot.dropped_samples == 0
    stage.keeper.drop = 3
    snapshot = stage.frame()
    assert snapshot.dropped_samples == 3
    assert stage.frame().dropped_samples == 6
    stage.keeper.drop = 0
    assert stage.frame(0.01, Reset()).dropped_samples == 0


def test_a_failed_run_ends_with_its_status(live):
    """The consumer learns how the run ended."""
    stage = live()
    stage.frame(0.0, ChangeScenario({"controller.feedback_gain": 1e6, "simulation.step": 1e-3}))
    stage.play(0.3)
    status = stage.runner.snapshot.status
    assert status.failed
    stage.runner.stop()
    assert stage.keeper.ends == [(1, status)]
    assert stage.keeper.ends[0][1].text == status.text


def test_stopping_a_runner_twice_ends_its_run_once(live):
    stage = live()
    stage.play(0.05)
    stage.runner.stop()
    stage.runner.stop()
    assert len(stage.keeper.ends) == 1
