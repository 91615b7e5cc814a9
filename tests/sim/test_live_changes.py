"""Slow changes are derived beside the running world, and floods of them are merged; every run can be replayed."""

from collections.abc import Callable
from concurrent.futures import Executor, Future

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario, LoadScenario, Play, Pull, Reset, StepOnce, Tap
from flexlab.sim.pacing import RUNS_AT_ONCE
from flexlab.sim.world import World

FINE = 12
"""Number of elements: too many to be derived at once."""


class ByHand(Executor):
    """An executor that works only when it is told to."""

    def __init__(self) -> None:
        self.waiting: list[tuple[Future, Callable]] = []

    def submit(self, work, /, *arguments, **options) -> Future:
        future: Future = Future()
        self.waiting.append((future, lambda: work(*arguments, **options)))
        return future

    def finish(self) -> None:
        """Do all work that waits."""
        for future, work in self.waiting:
            future.set_result(work())
        self.waiting.clear()


@pytest.fixture
def fine(live):
    """A live runner with a fine mesh, 50 ms after its start, and the executor of its derivations."""
    executor = ByHand()
    stage = live(load_preset("paper").replace({"payload.element_count": FINE}), executor=executor)
    stage.play(0.05)
    return stage, executor


def stiffness(snapshot) -> float:
    return snapshot.scenario.payload.bending_stiffness


def assert_replays(stage) -> None:
    """Assert that every run of a stage has the same bits when simulated again with its commands at their ticks."""
    for number, _, scenario, start in stage.keeper.runs:
        world = World(scenario)
        world.restore(start)
        time = stage.keeper.signal("time", number)
        events = [event for run, event in stage.keeper.events if run == number and event.level == "info"]
        commands = [event for event in events if isinstance(event.command, (ChangeScenario, Pull, Tap))]
        again = [world.observe()]
        for event in commands:
            again.append(world.advance(round(event.time / 1e-3) - world.tick))
            if world.apply(event.command):
                assert event is commands[-1], "a new run begins, and this one says no more"
                break
        else:
            again.append(world.advance(round(time[-1] / 1e-3) - world.tick))
        for name in ("time", "pose", "beam_rates", "joint_torque", "bound_estimates"):
            repeated = np.concatenate([getattr(block, name) for block in again])
            assert np.array_equal(repeated, stage.keeper.signal(name, number)), (number, name)


def test_a_slow_change_takes_effect_when_it_is_ready(fine):
    """Until then the world goes on as it was, and cheap changes act at once."""
    stage, executor = fine
    snapshot = stage.frame(0.02, ChangeScenario({"payload.bending_stiffness": 50.0}))
    assert stiffness(snapshot) == 100.0
    before = float(snapshot.latest.time[0])
    snapshot = stage.frame(0.02, ChangeScenario({"controller.feedback_gain": 250.0}))
    assert (stiffness(snapshot), snapshot.scenario.controller.feedback_gain) == (100.0, 250.0)
    assert float(snapshot.latest.time[0]) > before
    executor.finish()
    snapshot = stage.frame(0.02)
    assert (stiffness(snapshot), snapshot.scenario.controller.feedback_gain) == (50.0, 250.0)
    texts = [event.text for event in snapshot.events]
    assert ["Feedback" in text for text in texts] == [True, False], "events tell the order in which changes acted"
    assert snapshot.events[-1].time == pytest.approx(before + 0.02, abs=0.0011)
    stage.play(0.05)
    assert_replays(stage)


def test_values_that_arrive_during_a_derivation_are_merged_into_the_last(fine):
    """One derivation serves the first value, and one all that came while it ran."""
    stage, executor = fine
    for value in (90.0, 80.0, 70.0, 60.0):
        stage.frame(0.02, ChangeScenario({"payload.bending_stiffness": value}))
    assert len(executor.waiting) == 1
    executor.finish()
    assert stiffness(stage.frame(0.02)) == 90.0
    executor.finish()
    snapshot = stage.frame(0.02)
    assert stiffness(snapshot) == 60.0
    assert [event.command.changes["payload.bending_stiffness"] for event in snapshot.events] == [90.0, 60.0]
    stage.play(0.05)
    assert_replays(stage)


def test_another_preset_replaces_what_is_being_prepared(fine):
    """A slow preset, and the commands to it, wait beside the old run; the next preset replaces them."""
    stage, executor = fine
    other = load_preset("soft-beam").replace({"payload.element_count": FINE})
    stage.frame(0.02, ChangeScenario({"payload.bending_stiffness": 50.0}))
    snapshot = stage.frame(0.02, LoadScenario(other, "other"), ChangeScenario({"gravity": 1.0}))
    assert (snapshot.run_number, snapshot.scenario.gravity) == (1, 0.0)
    executor.finish()
    snapshot = stage.frame(0.02)
    assert (snapshot.run_number, snapshot.name, snapshot.scenario.gravity) == (2, "other", 1.0)
    stage.frame(0.02, LoadScenario(load_preset("paper").replace({"payload.element_count": FINE + 1}), "never"))
    snapshot = stage.frame(0.02, LoadScenario(load_preset("paper"), "paper"))
    executor.finish()
    snapshot = stage.frame(0.02)
    assert (snapshot.run_number, snapshot.name) == (3, "paper")
    stage.play(0.05)
    assert_replays(stage)


def test_a_change_whose_derivation_fails_is_reported_and_the_run_goes_on(fine):
    stage, executor = fine
    stage.frame(0.02, ChangeScenario({"payload.bending_stiffness": 50.0}))
    executor.waiting.pop()[0].set_exception(MemoryError("no room"))
    snapshot = stage.frame(0.02)
    assert snapshot.events[-1].level == "error"
    assert "no room" in snapshot.events[-1].text
    stage.play(0.05)
    assert_replays(stage)


@pytest.mark.parametrize(
    "command", [Reset(), LoadScenario(load_preset("soft-beam"), "soft-beam")], ids=["reset", "load"]
)
def test_a_burst_of_resets_or_loads_begins_a_single_run(live, command):
    """Of 1000 at once, only the last run begins."""
    stage = live()
    stage.play(0.05)
    assert stage.frame(0.02, *[command] * 1000).run_number == 2
    assert len(stage.keeper.runs) == 2


def test_a_lasting_flood_of_new_runs_is_slowed_down(live):
    """Of one every frame, the first few begin at once, then one a second; the last one asked for remains."""
    stage = live()
    for k in range(4 * RUNS_AT_ONCE):
        stage.frame(1 / 60, ChangeScenario({"gravity": k / 100}), Reset())
    assert len(stage.keeper.runs) <= RUNS_AT_ONCE + 1 + 4 * RUNS_AT_ONCE / 60
    stage.play(1.1)
    assert stage.runner.snapshot.scenario.gravity == pytest.approx((4 * RUNS_AT_ONCE - 1) / 100)


def test_a_flood_of_all_kinds_of_commands_can_be_replayed(live):
    """Eight people send random commands, and derivations finish at random times: each run can be repeated bit for bit."""
    rng, executor = np.random.default_rng(3), ByHand()
    stage = live(executor=executor)
    slow = ({"payload.element_count": n} for n in (FINE, FINE + 1, 3, FINE))
    for k in range(90):
        commands: list = []
        for _ in range(8):
            value = float(rng.uniform())
            commands += [
                ChangeScenario({"controller.feedback_gain": 150 + 100 * value}),
                ChangeScenario({"payload.bending_stiffness": 50 + 100 * value}),
                ChangeScenario({"trajectory.frequency": (1 + value, 1.0, 1.0)}),
                Tap(0.1, (0.0, value / 100)),
                Pull(0.0, (0.0, value), 100 * value),
            ]
        order = rng.permutation(len(commands))[: int(rng.integers(0, 20))]
        extra = [ChangeScenario(next(slow))] if k % 20 == 10 else [Reset()] if k == 75 else []
        stage.frame(float(rng.uniform(0, 0.03)), *[commands[at] for at in order], *extra)
        if rng.uniform() < 0.3:
            executor.finish()
    assert len(stage.keeper.runs) >= 5
    assert stage.runner.snapshot.status == "running"
    assert_replays(stage)


def test_an_interrupted_tick_leaves_no_trace(same_bits):
    """The world is as it was before the block, held torques and delay line included."""
    scenario = load_preset("paper").replace({"controller.control_period": 2e-4, "controller.input_delay": 2})
    world, quiet = World(scenario), World(scenario)
    for one in (world, quiet):
        one.advance(20)
    world.interrupt()
    assert len(world.advance(5)) == 0
    assert world.tick == 20
    same_bits(world.run(20), quiet.run(20))


def test_many_ticks_asked_for_at_once_are_done_over_several_rounds(live):
    """With a clock that moves while the engine works, each round does its share, and all ticks are done exactly once."""
    stage = live(playing=False)
    fill = stage.runner._run.world.fill

    def slow(rows):
        stage.now += 1e-3 * len(rows)
        return fill(rows)

    stage.runner._run.world.fill = slow
    snapshot = stage.frame(0.02, StepOnce(200))
    assert 0 < float(snapshot.latest.time[0]) < 0.06
    assert snapshot.latest.time[0] + 0.001 * snapshot.steps_left == pytest.approx(0.2, abs=1e-12), "where it goes"
    for _ in range(30):
        snapshot = stage.frame(0.02)
    assert float(snapshot.latest.time[0]) == pytest.approx(0.2, abs=1e-12)
    stage.frame(0.02, StepOnce(1000))
    snapshot = stage.frame(0.02, Play())
    assert snapshot.playing, "playing on ends the steps"
