"""Scenarios that an earlier version wrote still mean what they meant then."""

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexlab.errors import ScenarioError
from flexlab.presets import load_preset, scenario_text
from flexlab.recording.reader import read_recording
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim.world import World


def old(factor: Any = 1.0, strain: Any = 0.0) -> dict[str, Any]:
    """The preset vibration-damping as version 0.1.0 wrote it."""
    data = json.loads(scenario_text(load_preset("vibration-damping")))
    del data["payload"]["thickness"], data["controller"]["sensor_noise"]["moment_rate"]
    data["controller"]["model"]["bending_stiffness_factor"] = factor
    data["controller"] |= {"control_period": 0.001}
    data["controller"]["sensor_noise"]["strain"] = strain
    return data


def test_the_old_believed_stiffness_is_left_out_with_a_warning_unless_it_was_1(caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.WARNING):
        assert parse_scenario(old()) == load_preset("vibration-damping").replace({"controller.control_period": 0.001})
        assert not caplog.messages
        assert parse_scenario(old(3.0)) == parse_scenario(old())
    (sentence,) = caplog.messages
    assert sentence.startswith("controller.model.bending_stiffness_factor = 3.0 is left out")
    assert "bending_stiffness_factor" not in scenario_text(parse_scenario(old()))


def test_an_old_strain_becomes_the_same_noise_of_the_moment_rates():
    noise = parse_scenario(old(strain=0.01)).controller.sensor_noise
    assert (noise.strain, noise.moment_rate) == (0.0, (0.01 * 1.0, 0.01 * 0.5))


def test_a_new_strain_is_read_as_a_strain():
    new = load_preset("vibration-damping").replace(
        {"controller.control_period": 0.001, "controller.sensor_noise.strain": 1e-6}
    )
    assert parse_scenario(json.loads(scenario_text(new))).controller.sensor_noise.strain == 1e-6
    assert parse_scenario({"controller": {"kind": "pd", "model": {}}}).controller.sensor_noise.strain == 0


def test_a_change_of_the_old_field_is_accepted_and_changes_nothing():
    paper = load_preset("paper")
    assert paper.replace({"controller.model.bending_stiffness_factor": 2.0}) == paper


@pytest.mark.parametrize("value", ["much", None, [1], {}])
def test_an_invalid_old_strain_is_refused_but_any_old_stiffness_is_left_out(value: Any):
    with pytest.raises(ScenarioError, match="strain"):
        parse_scenario(old(strain=value))
    assert isinstance(parse_scenario(old(factor=value)), Scenario)


def test_a_noisy_run_of_the_first_format_gets_the_same_noise_again(root: Path):
    """Torques follow the noise at once; up to the first command, nothing else has changed since that format."""
    recording = read_recording(root / "tests/recording/golden/format-1/sampled-control.rrd")
    assert recording.scenario.controller.sensor_noise.moment_rate == (1e-6, 5e-7)
    assert recording.start is not None
    world = World(recording.scenario)
    world.restore(recording.start)
    ticks = round(recording.events[0].time / 0.001) - 1
    again, then = world.run(ticks), recording.samples.slice(0, ticks + 1)
    largest = abs(then.joint_torque).max()
    np.testing.assert_allclose(again.joint_torque, then.joint_torque, rtol=0, atol=1e-12 * largest)
