"""Motors with a time constant and a no-load speed: integrators, steps, live changes, poles, refusals."""

import numpy as np
import pytest
from going_on import whole_run_as_in_blocks

import flexlab
from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

LATE = {"joints.motor.time_constant": 0.004}
WEAK = {"joints.motor.stall_torque": (450.0, 250.0, 90.0), "joints.motor.no_load_speed": (7.0, 6.0, 9.0)}
MOTORS = {**LATE, **WEAK, "joints.friction.viscous": (5.0, 5.0, 2.0)}
CONTROL = [{}, {"controller.control_period": 0.001}]


@pytest.mark.parametrize("integrator", ["rk4", "generalized-alpha"])
def test_all_integrators_find_the_same_motion(integrator):
    scenario = load_preset("paper").replace(MOTORS)
    one, other = (simulate(scenario.replace({"simulation.integrator": name}), 0.2) for name in ("etdrk4", integrator))
    np.testing.assert_allclose(one.pose, other.pose, rtol=0, atol=2e-8)
    np.testing.assert_allclose(one.internal_force, other.internal_force, atol=1e-4 * np.abs(one.internal_force).max())


@pytest.mark.parametrize("control", CONTROL)
@pytest.mark.parametrize("changes", [LATE, WEAK, MOTORS, {"joints.motor.time_constant": 2e-4}])
def test_automatic_steps_resolve_motors(changes, control):
    scenario = load_preset("paper").replace({**changes, **control})
    step, run = World(scenario).step, simulate(scenario, 0.3)
    assert run.status.text == "Finished at t = 0.3 s."
    finer = simulate(scenario.replace({"simulation.step": step / 8}), 0.3)
    np.testing.assert_allclose(run.pose, finer.pose, rtol=0, atol=1e-8)
    force = np.abs(finer.internal_force).max()
    np.testing.assert_allclose(run.internal_force, finer.internal_force, rtol=0, atol=1e-4 * force)


@pytest.mark.parametrize("control", CONTROL)
def test_blocks_and_continued_runs_have_the_same_bits(control):
    whole_run_as_in_blocks(load_preset("paper").replace({**MOTORS, **control}))


@pytest.mark.parametrize("control", CONTROL)
def test_a_time_constant_can_begin_and_end_during_a_run_without_a_jump(control):
    world = World(load_preset("paper").replace(control))
    world.advance(100)
    before = world.observe()
    world.apply(ChangeScenario(LATE))
    after = world.observe()
    np.testing.assert_allclose(after.joint_torque, before.joint_torque, rtol=0, atol=1e-9)
    np.testing.assert_allclose(after.own["left_asked_torque"][0], before.joint_torque[0, 0], rtol=0, atol=1e-9)
    world.advance(10)
    before = world.observe().joint_torque
    world.apply(ChangeScenario({"joints.motor.time_constant": 0.002, "payload.bending_stiffness": 120.0}))
    np.testing.assert_array_equal(world.observe().joint_torque, before)
    world.apply(ChangeScenario({"joints.motor.time_constant": 0.0}))
    assert "left_asked_torque" not in world.observe().own
    world.advance(50)
    assert not world.status.failed


def test_with_one_arm_the_states_of_motors_and_encoders_are_not_confused():
    world = World(load_preset("single-arm").replace({"controller.control_period": 0.0002, **LATE}))
    world.advance(50)
    world.apply(ChangeScenario({"joints.motor.time_constant": 0.0, "joints.encoders.counts": (1e6,) * 3}))
    world.advance(50)
    assert not world.status.failed
    assert np.abs(world.observe().tracking_error).max() < 0.05


def test_a_motor_that_is_too_weak_is_called_saturated():
    run = simulate(load_preset("paper").replace(WEAK), 0.1)
    asked = np.stack([run.own["left_asked_torque"], run.own["right_asked_torque"]], axis=1)
    less = (np.abs(asked - run.joint_torque) > 1e-9).any(axis=(1, 2))
    assert less.any()
    np.testing.assert_array_equal(run.saturated > 0, less)


def test_the_controllers_own_torque_limit_applies_before_the_motors():
    limit = (300.0, 200.0, 50.0)
    run = simulate(load_preset("paper").replace({**LATE, "controller.torque_limit": limit}), 0.1)
    assert np.abs(run.own["left_asked_torque"]).max(axis=0) == pytest.approx(limit, abs=1e-9)
    assert (np.abs(run.joint_torque[:, 0]) <= np.array(limit) * (1 + 1e-9)).all()
    assert run.saturated[0] > 0


def test_poles_show_when_slow_motors_make_the_loop_unstable():
    hold = {"trajectory": {"kind": "hold", "pose": (0.0, 0.75, 0.0)}, "controller.kind": "pd"}
    start = {"initial.pose": (1e-6, 0.75, 0.0), "initial.pose_rate": (0.0, 0.0, 0.0)}
    said = []
    for late in (0.002, 0.01, 0.03, 0.06, 0.12):
        scenario = load_preset("paper").replace({**hold, **start, "joints.motor.time_constant": late})
        growth = float(flexlab.modes(scenario).poles.real.max())
        error = np.abs(simulate(scenario, 3.0).tracking_error)
        assert (error[-500:].max() > 1e-6) == (growth > 0), (late, growth)
        said.append(growth > 0)
    assert not said[0]
    assert said[-1]


def test_impossible_motors_are_refused_with_a_reason():
    with pytest.raises(ScenarioError, match=r"joints\.motor\.time_constant.*0 to 1 s"):
        load_preset("paper").replace({"joints.motor.time_constant": -1.0})
    with pytest.raises(ScenarioError, match=r"motors' time constant would need a step .*joints\.motor\.time_constant"):
        World(load_preset("paper").replace({"joints.motor.time_constant": 1e-7}))
