"""Encoders: the limit of many counts, few counts, live changes, same bits, refusals."""

import numpy as np
import pytest
from going_on import whole_run_as_in_blocks

import flexlab
from flexlab.errors import ScenarioError, StudyError
from flexlab.gym_environment.worlds import Settings, WorldBatch
from flexlab.presets import load_preset
from flexlab.sim.closed_loop import own_states_of
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

CLOCKED = {"controller.control_period": 0.001}
COUNTS = "joints.encoders.counts"


def with_counts(number: float, **changes: object):
    return load_preset("paper").replace({**CLOCKED, COUNTS: (number,) * 3, **changes})


def test_with_very_many_counts_only_the_lag_of_the_rate_remains():
    finest, fine = (simulate(with_counts(number), 0.5) for number in (1e9, 1e7))
    np.testing.assert_allclose(fine.pose, finest.pose, rtol=0, atol=2e-6)
    exact = simulate(load_preset("paper").replace(CLOCKED), 0.5)
    assert np.abs(exact.pose - finest.pose).max() > 1e-5  # the lag of half a period


def test_torques_jump_more_with_coarser_counts():
    jumps = [np.abs(np.diff(simulate(with_counts(n), 1.0).joint_torque[500:], axis=0)).max() for n in (1e4, 2e4, 1e6)]
    assert jumps[0] > 1.5 * jumps[1] > 3 * jumps[2]


def test_a_payload_held_still_stays_within_the_resolution_of_the_encoders():
    hold = {"trajectory": {"kind": "hold", "pose": (0.0, 0.75, 0.0)}, "controller.kind": "pd"}
    run = simulate(with_counts(4096.0, **hold), 2.0)
    reach = 2 * np.pi / 4096 * 1.5
    assert np.abs(run.tracking_error[-500:]).max() < 2 * reach


def test_a_single_joint_may_have_an_encoder():
    world = World(load_preset("paper").replace({**CLOCKED, COUNTS: (0.0, 0.0, 2000.0)}))
    now = world.advance(50)
    told = own_states_of(world.system, world.state().y)["reading"]
    angle, count = now.joint_angle[-1, :, 2], 2 * np.pi / 2000
    rounded = np.mean(np.round(angle / count) * count - angle)
    assert abs(told[2] - now.pose[-1, 2] - rounded) < 1e-12


@pytest.mark.parametrize("noise", [{}, {"controller.sensor_noise.pose": (1e-5, 1e-5, 1e-5)}])
def test_blocks_and_continued_runs_have_the_same_bits(noise):
    whole_run_as_in_blocks(with_counts(2e5, **noise))


def test_counts_can_change_during_a_run():
    world = World(load_preset("paper").replace(CLOCKED))
    world.advance(100)
    before = world.observe()
    assert not world.apply(ChangeScenario({COUNTS: (1e5,) * 3}))  # Rows keep their columns: the same run.
    np.testing.assert_allclose(world.observe().pose_rate, before.pose_rate, rtol=0, atol=1e-12)
    world.advance(100)
    world.apply(ChangeScenario({COUNTS: (3e5,) * 3}))
    world.apply(ChangeScenario({"controller.control_period": 0.0005}))
    first = np.abs(np.diff(world.advance(20).joint_torque, axis=0)).max()
    later = np.abs(np.diff(world.advance(200).joint_torque, axis=0)).max()
    assert first < 1.5 * later  # Readings of different periods make no rate.
    world.apply(ChangeScenario({COUNTS: (0.0,) * 3}))
    world.advance(100)
    assert not world.status.failed


@pytest.mark.parametrize("ticks", [20, 21, 23])
@pytest.mark.parametrize(
    ("start", "change"),
    [
        ({"controller.control_period": 0.001, COUNTS: (1e9,) * 3}, {"controller.control_period": 0.004}),
        ({"controller.control_period": 0.004}, {COUNTS: (1e9,) * 3}),
        ({}, {"controller.control_period": 0.004, COUNTS: (1e9,) * 3}),
    ],
)
def test_the_first_rate_of_a_clock_or_encoder_that_begins_spans_one_period(start, change, ticks):
    """Encoders without a resolution differ from exact rates by the lag of half a period alone."""
    torques = []
    for counts in (1e9, 0.0):
        both = {COUNTS: (counts,) * 3}
        world = World(load_preset("paper").replace(start | (both if COUNTS in start else {})), 0.001)
        world.advance(ticks)
        world.apply(ChangeScenario(change | (both if COUNTS in change else {})))
        torques.append(world.advance(4).joint_torque[-1])
    assert np.abs(torques[0] - torques[1]).max() < 0.3 * np.abs(torques[1]).max()


def test_the_friction_loss_goes_on_when_encoders_come_and_go():
    friction = {"joints.friction.viscous": (5.0, 5.0, 2.0)}
    world = World(with_counts(1e5, **friction))
    lost = world.advance(50).own["friction_loss"][-1]
    world.apply(ChangeScenario({COUNTS: (0.0,) * 3}))
    assert world.observe().own["friction_loss"][0] == lost > 0
    world.apply(ChangeScenario({COUNTS: (1e5,) * 3}))
    assert world.observe().own["friction_loss"][0] == lost
    assert not world.advance(50).own["friction_loss"][-1] < lost


def test_a_run_warns_that_its_results_are_certain_up_to_a_count():
    world = World(with_counts(1e5))
    world.advance(200)
    assert "up to one count of the encoders" in world.accuracy_warning


def test_the_poles_include_the_lag_of_differenced_rates():
    """Around the edge of stability, a PD loop with exact or differenced rates grows exactly where its poles say so."""
    hold = {"trajectory": {"kind": "hold", "pose": (0.0, 0.75, 0.0)}, "controller.kind": "pd"}
    start = {"initial.pose": (1e-6, 0.75, 0.0), "initial.pose_rate": (0.0, 0.0, 0.0), "controller.input_delay": 1}
    found = []
    for number in (0.0, 1e9):
        for gain in (1000.0, 2700.0, 4000.0):
            scenario = with_counts(number, **hold, **start).replace({"controller.velocity_gain": gain})
            growth = float(flexlab.modes(scenario).poles.real.max())
            run = simulate(scenario, 0.2)
            grows = run.status.failed or np.abs(run.tracking_error[-20:]).max() > 1e-6
            assert grows == (growth > 0), (number, gain, growth)
            found.append(grows)
    assert found == [False, False, True, False, True, True]


def test_encoders_that_cannot_work_are_refused_or_named_as_the_cause():
    with pytest.raises(
        ScenarioError, match=r"joints\.encoders\) belong to sampled control: .*control_period.* or .* 0"
    ):
        load_preset("paper").replace({COUNTS: (1e4,) * 3})
    with pytest.raises(StudyError, match=r"joints\.encoders cannot be used in the environment"):
        WorldBatch(Settings(scenario=with_counts(1e4)), 1)
    run = simulate(with_counts(100.0), 1.0)
    assert run.status.failed
    assert "encoder steps taken for rates drive it" in run.status.text
    assert "Reset with more joints.encoders.counts" in run.status.text
