"""A run can be continued from any instant of the last minute, with exactly the state that it had."""

import numpy as np
import pytest

from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.history import state_from
from flexlab.sim.world import World


@pytest.mark.parametrize("time", [0.1, 0.35, 0.4, 0.6, 0.9, 1.0])
def test_a_past_instant_is_recomputed_bit_for_bit_and_goes_on_the_same_way(live, same_bits, time: float):
    """The run has a tap, a change of stiffness and a pull."""
    stage = live()
    stage.play(0.3)
    stage.frame(1 / 60, Tap(0.5, (0.0, 0.5)))
    stage.play(0.2)
    stage.frame(1 / 60, ChangeScenario({"payload.bending_stiffness": 50.0}))
    stage.play(0.2)
    stage.frame(1 / 60, Pull(0.5, (0.1, 0.4), 100.0))
    stage.play(0.4)
    runner = stage.runner
    checkpoint = runner.checkpoint(time)
    assert 0 <= round(1000 * time) - checkpoint.state.tick <= 250
    world = World(checkpoint.scenario)
    world.restore(state_from(checkpoint, round(1000 * time)))
    now = float(runner.snapshot.latest.time[0])
    seen = runner.recent(0.0, now - time)
    assert float(seen.time[0]) == pytest.approx(time)
    same_bits(world.observe(), seen)
    following = runner.checkpoint(time + 0.01)
    if following.state.tick <= checkpoint.state.tick:  # No command comes in between.
        same_bits(world.advance(10), runner.recent(0.009, now - time - 0.01))


def test_checkpoints_are_bounded(live, monkeypatch):
    """They are limited in time and in number, however much a person drags a slider."""
    monkeypatch.setattr("flexlab.sim.history.MOST", 80)
    stage = live()
    for number in range(120):
        stage.frame(1 / 60, ChangeScenario({"controller.feedback_gain": 200.0 + number % 7}))
    kept = list(stage.runner._run.checkpoints._kept)
    assert len(kept) == 80
    ticks = np.array([one.state.tick for one in kept])
    assert (np.diff(ticks) > 0).all()
    monkeypatch.setattr("flexlab.sim.history.HISTORY_SECONDS", 1.0)
    stage.frame(1 / 60, ChangeScenario({"controller.feedback_gain": 250.0}))
    oldest, second, *_, newest = (one.state.tick for one in stage.runner._run.checkpoints._kept)
    assert oldest <= newest - 1000 < second
