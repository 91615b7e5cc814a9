"""The error monitor: what is no longer accurate is called so, what is accurate is not, and no bit of the run changes."""

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim import accuracy
from flexlab.sim.runner import Runner
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World


def undamped() -> Scenario:
    """Fine modes that ring on: the steps' errors add up in them."""
    still = {"kind": "nodal", "coefficient": 0.0}
    return load_preset("paper").replace({"payload.element_count": 8, "payload.damping": still})


def test_an_undamped_fine_beam_is_called_inaccurate():
    run = simulate(undamped(), 1.0)
    assert run.status == "finished"
    assert "Results are no longer accurate since about t = " in run.status.text
    assert "internal force may be off by" in run.status.text


@pytest.mark.parametrize("name", ["paper", "single-arm"])
def test_plain_presets_are_called_accurate(name: str):
    assert simulate(load_preset(name), 1.0).status.text == "Finished at t = 1 s."


def test_the_runner_says_it_once_and_the_snapshot_keeps_it():
    runner = Runner(undamped(), playing=False, clock=lambda: 0.0)
    while not runner._world.accuracy_warning:
        runner._advance(50)
    for _ in range(20):
        runner._advance(50)
    runner._publish(0.0)
    told = [event for event in runner.snapshot.events if "no longer accurate" in event.text]
    assert len(told) == 1
    assert told[0].text == runner.snapshot.accuracy_warning


def test_the_monitor_changes_no_bit_and_block_sizes_change_no_warning(monkeypatch: pytest.MonkeyPatch):
    """Also with a sampled law, whose held torques and delay line the redone tick must leave alone."""
    sampled = {"controller.control_period": 0.002, "controller.input_delay": 1}
    scenario = undamped().replace(sampled)
    whole = World(scenario)
    rows = whole.advance_rows(400)
    pieces = World(scenario)
    parts = np.concatenate([pieces.advance_rows(ticks) for ticks in (1, 63, 1, 7, 128, 200)])
    assert np.array_equal(rows, parts)
    assert whole.accuracy_warning == pieces.accuracy_warning
    monkeypatch.setattr(accuracy, "redo_tick", lambda *_: None)
    assert np.array_equal(rows, World(scenario).advance_rows(400))
