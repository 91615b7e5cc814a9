"""A controller that acts at fixed instants and holds its torques between them."""

import numpy as np
import pytest
from going_on import whole_run_as_in_blocks

from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World


def run(ticks: int, **changes) -> Samples:
    world = World(load_preset("paper").replace(changes))
    samples = world.run(ticks)
    assert world.status == "running", world.status.text
    return samples


@pytest.mark.parametrize("start", ["jerk", "smooth"])
@pytest.mark.parametrize("kind", ["adaptive-sliding-mode", "vibration-damping", "computed-torque", "pd"])
def test_short_periods_converge_to_the_continuous_law(kind: str, start: str):
    """The difference in pose is proportional to the period, as a hold lags by half of it."""
    changes = {"controller.kind": kind, "initial.pose_rate": (0.0, 0.0, 0.0) if start == "jerk" else None}
    scenario = load_preset("paper").replace(changes)
    continuous = simulate(scenario, 0.3)
    gaps = []
    for period in (4e-4, 2e-4, 1e-4, 5e-5):
        sampled = simulate(scenario.replace({"controller.control_period": period}), 0.3)
        gaps.append(np.abs(sampled.pose - continuous.pose).max())
    slopes = -np.diff(np.log2(gaps))
    assert np.all(np.abs(slopes - 1) < 0.1), (gaps, slopes)
    assert gaps[-1] < 5e-5


@pytest.mark.parametrize("period", [0.002, 0.005])
def test_torques_are_constant_between_control_instants(period: float):
    """Joint torques are held within a period and new at each instant; 𝒥ᵀτ changes with the pose meanwhile."""
    samples = run(60, **{"controller.control_period": period, "initial.pose_rate": None})
    per_period = round(period / 0.001)
    held = samples.joint_torque[: 60 - 60 % per_period].reshape(-1, per_period, 2, 3)
    scale = np.abs(held).max()
    np.testing.assert_allclose(held, np.broadcast_to(held[:, :1], held.shape), rtol=0, atol=1e-11 * scale)
    assert np.all(np.abs(np.diff(held[:, 0], axis=0)).max(axis=(1, 2)) > 1e-3)
    first = samples.arm_input[:per_period]
    assert np.abs(first[-1] - first[0]).max() > 1e-6


def test_a_sampled_controller_acts_from_the_start():
    """At t = 0 the sampled controller has acted: its torques are the continuous law's."""
    sampled, continuous = run(0, **{"controller.control_period": 0.002}), run(0)
    np.testing.assert_allclose(sampled.joint_torque, continuous.joint_torque, rtol=1e-12)


@pytest.mark.parametrize("delay", [1, 3, 8])
def test_torques_take_effect_after_the_delay(delay: int):
    """Motors are off for `delay` periods; then those of instant k act at instant k + delay."""
    period = 0.002
    changes = {"controller.control_period": period, "initial.pose_rate": None}
    prompt = run(4, **changes)
    late = run(2 * (delay + 2), **changes, **{"controller.input_delay": delay})
    off = late.joint_torque[: 2 * delay]
    np.testing.assert_array_equal(off, 0)
    np.testing.assert_allclose(late.joint_torque[2 * delay], prompt.joint_torque[0], rtol=0, atol=1e-10)
    assert np.abs(late.joint_torque[2 * delay + 2] - late.joint_torque[2 * delay]).max() > 1e-3


@pytest.mark.parametrize(("sample_period", "common"), [(0.001, 0.002), (0.003, 0.006)])
def test_control_instants_do_not_depend_on_the_sample_period(sample_period: float, common: float):
    """A controller with a period of 1.2 ms gives the same motion, within 1e-9 m, sampled every 0.4 ms, 1 ms or 3 ms."""
    scenario = load_preset("paper").replace({"controller.control_period": 0.0012})
    fine, other = simulate(scenario, 0.24, 0.0004), simulate(scenario, 0.24, sample_period)
    a, b = fine.pose[:: round(common / 0.0004)], other.pose[:: round(common / sample_period)]
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)


@pytest.mark.parametrize("period", [0.0001234567, np.pi * 1e-3, 0.00100001])
def test_incommensurable_periods_are_refused_in_a_sentence(period: float):
    """The sentence names the field, both periods with their unit, and what to choose."""
    with pytest.raises(ScenarioError) as refusal:
        World(load_preset("paper").replace({"controller.control_period": float(period)}))
    text = str(refusal.value)
    assert f"controller.control_period = {period:.12g} s and the sample period 0.001 s" in text
    assert "choose a multiple" in text


def test_delay_and_noise_without_a_period_are_refused():
    """Both belong to sampled control."""
    for change in ({"controller.input_delay": 2}, {"controller.sensor_noise.pose": (1e-3, 0.0, 0.0)}):
        with pytest.raises(ScenarioError, match="control_period"):
            load_preset("paper").replace(change)


def test_new_gains_act_at_the_next_instant():
    """Held torques stay until the controller acts again."""
    world = World(load_preset("paper").replace({"controller.control_period": 0.005, "initial.pose_rate": None}))
    world.advance(11)
    held = world.observe().joint_torque
    world.apply(ChangeScenario({"controller.feedback_gain": 900.0}))
    after = world.advance(6).joint_torque
    np.testing.assert_allclose(after[:3], np.broadcast_to(held, (3, 2, 3)), rtol=1e-9)
    assert np.abs(after[3] - held[0]).max() > 1e-3


@pytest.mark.parametrize("periods", [(0.001, 0.002), (0.002, 0.001), (0.001, 0.003)])
def test_a_new_period_keeps_the_order_of_torques_on_their_way(periods: tuple[float, float]):
    """Delayed torques arrive in the order they were sent, also across a live change of the period.

    On a slow smooth motion torques change steadily; a torque out of order would show as a step back.
    """
    changes = {"controller.control_period": periods[0], "controller.input_delay": 3, "initial.pose_rate": None}
    world = World(load_preset("smooth-start").replace(changes))
    world.advance(102)
    before = world.observe().joint_torque[0, 0, 0]
    world.apply(ChangeScenario({"controller.control_period": periods[1]}))
    after = world.advance(15).joint_torque[:, 0, 0]
    steps = np.diff(np.concatenate([[before], after]))
    assert float(steps.min()) > -1e-9, steps


@pytest.mark.parametrize("delays", [(1, 3), (3, 1), (0, 4), (4, 0)])
def test_a_new_delay_neither_drops_nor_reorders_torques(delays: tuple[int, int]):
    """A longer delay holds the last torque until the next arrives, a shorter one skips ahead; the motors never go off."""
    changes = {"controller.control_period": 0.001, "controller.input_delay": delays[0], "initial.pose_rate": None}
    world = World(load_preset("smooth-start").replace(changes))
    world.advance(102)
    before = world.observe().joint_torque[0, 0, 0]
    world.apply(ChangeScenario({"controller.input_delay": delays[1]}))
    after = world.advance(15).joint_torque[:, 0, 0]
    assert float(np.diff(np.concatenate([[before], after])).min()) > -1e-9, after


@pytest.mark.parametrize("delay", [0, 1, 5])
def test_motors_go_on_when_a_delayed_controller_takes_over(delay: int):
    """Until its first torques arrive, the motors hold the last ones of the continuous controller."""
    world = World(load_preset("smooth-start"))
    world.advance(102)
    before = world.observe().joint_torque[0]
    world.apply(ChangeScenario({"controller.control_period": 0.001, "controller.input_delay": delay}))
    after = world.advance(10).joint_torque
    assert np.abs(after - before).max() < 0.2 * np.abs(before).max()
    if delay:
        np.testing.assert_allclose(after[: delay - 1], np.broadcast_to(before, (delay - 1, 2, 3)), rtol=0, atol=1e-9)
        assert np.abs(after[delay] - before).max() > 1e-3


@pytest.mark.parametrize("law", ["composite", "lqr"])
def test_a_prediction_beyond_the_delay_depends_on_the_state_alone(law: str):
    """A run that goes on from a state has the same bits: lqr used to need its previous input, which no state holds."""
    whole_run_as_in_blocks(load_preset(law).replace({"controller.observer.horizon": 2.5}), equal_nan=True)
