"""Headless runs: samples, commands, refusals."""

import numpy as np
import pytest

from flexlab.errors import StudyError
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.simulate import simulate, tick_at
from flexlab.sim.world import World


@pytest.mark.parametrize(
    ("duration", "period", "count"),
    [(3.0, 0.001, 3001), (0.3, 0.1, 4), (0.0, 0.001, 1), (0.0105, 0.001, 11), (0.7, 0.07, 11), (0.0009, 0.001, 1)],
)
def test_samples_lie_on_every_multiple_of_the_period_up_to_the_duration(duration: float, period: float, count: int):
    """Both ends are included if they are multiples, however they are rounded in binary."""
    run = simulate(load_preset("smooth-start"), duration, period)
    assert np.array_equal(run.time, np.arange(count) * period)
    assert run.status == "finished"


def test_the_motion_does_not_depend_on_the_sample_period():
    """Samples every 0.1 ms, 1 ms and 20 ms show one motion, to the accuracy of the steps."""
    fine = simulate(load_preset("paper"), 0.2, 0.0001)
    for period, every in ((0.001, 10), (0.02, 200)):
        run = simulate(load_preset("paper"), 0.2, period)
        np.testing.assert_allclose(run.pose, fine.pose[::every], rtol=0, atol=1e-9)
        np.testing.assert_allclose(run.beam_coordinates, fine.beam_coordinates[::every], rtol=0, atol=1e-8)


def test_shapes_are_those_of_the_readme():
    """(N,), (N, 3), (N, n_q), (N, arms, 3)."""
    run = simulate(load_preset("paper"), 0.01)
    assert (
        run.pose.shape == run.tracking_error.shape == run.sliding_variable.shape == run.bound_estimates.shape == (11, 3)
    )
    assert run.beam_coordinates.shape == run.beam_rates.shape == (11, 4)
    assert run.joint_angle.shape == run.joint_torque.shape == run.internal_force.shape == (11, 2, 3)
    single = simulate(load_preset("single-arm"), 0.01)
    assert single.joint_angle.shape == single.arm_input.shape == (11, 1, 3)
    assert len(run) == 11


def test_commands_take_effect_as_in_a_live_world():
    """They are given unsorted and act in the order of their times, each at the first sample that is not earlier."""
    commands = [
        (0.06, Pull(0.1, (0.1, 0.9), 200.0)),
        (0.0205, ChangeScenario({"payload.bending_stiffness": 40.0})),
        (0.04, Tap(0.0, (0.1, 0.2))),
    ]
    run = simulate(load_preset("paper"), 0.1, commands=commands)
    world = World(load_preset("paper"))
    parts = [world.run(21)]
    for until, command in ((40, commands[1][1]), (60, commands[2][1]), (100, commands[0][1])):
        world.apply(command)
        parts.append(world.advance(until - world.tick))
    pose = np.concatenate([part.pose for part in parts])
    assert np.array_equal(run.pose, pose)
    assert np.array_equal(run.input_work, np.concatenate([part.input_work for part in parts]))


def test_a_command_at_the_start_acts_and_one_after_the_end_does_nothing():
    late = simulate(load_preset("paper"), 0.05, commands=[(0.2, Tap(0.0, (1.0, 1.0)))])
    plain = simulate(load_preset("paper"), 0.05)
    assert np.array_equal(late.pose, plain.pose)
    early = simulate(load_preset("paper"), 0.05, commands=[(0.0, Tap(0.0, (1.0, 1.0)))])
    assert np.abs(early.pose - plain.pose).max() > 1e-4


@pytest.mark.parametrize(
    "command",
    [ChangeScenario({"payload.element_count": 5}), ChangeScenario({"payload.length": 0.4})],
    ids=["mesh", "restart"],
)
def test_a_command_that_breaks_the_run_in_two_is_refused(command):
    """The result is one run: another mesh or a restart does not fit in its arrays."""
    with pytest.raises(StudyError, match=r"t = 0\.01 s"):
        simulate(load_preset("paper"), 0.05, commands=[(0.01, command)])


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("duration", -1.0),
        ("duration", float("nan")),
        ("duration", float("inf")),
        ("duration", "3"),
        ("duration", None),
        ("duration", True),
        ("duration", 1e9),
        ("sample_period", 0.0),
        ("sample_period", -0.001),
        ("sample_period", 1e-9),
        ("sample_period", 100.0),
        ("sample_period", float("nan")),
        ("sample_period", "fast"),
    ],
)
def test_a_senseless_time_is_refused_by_name(name: str, value):
    """One sentence says the name, the value and what to give."""
    with pytest.raises(StudyError) as refusal:
        simulate(load_preset("paper"), **{name: value})
    assert name in str(refusal.value)
    assert str(refusal.value).endswith(".")


@pytest.mark.parametrize("number", [np.float64, np.float32])
def test_durations_may_be_numpy_numbers(number: type[np.floating]):
    """Parameters often come from linspace. One of single precision means the decimal that it shows: the last sample was lost."""
    run = simulate(load_preset("paper"), number(0.01), number(0.001))
    assert np.array_equal(run.time, np.arange(11) * 0.001)


def test_a_command_of_a_long_run_acts_at_its_own_sample():
    """At 32 771 391 ms, nine hours, the quotient of time and period is 4e-9 too large, and the command came a sample late."""
    assert tick_at(32_771_391 * 0.001, 0.001) == 32_771_391
    assert tick_at(0.0010001, 0.001) == 2


def test_the_run_knows_the_scenario_it_started_from_even_after_commands():
    paper = load_preset("paper")
    run = simulate(paper, 0.02, commands=[(0.01, ChangeScenario({"gravity": 5.0}))])
    assert run.scenario == paper


def test_a_run_that_fails_in_the_middle_keeps_its_good_samples():
    """The status has a sentence and a time, and the good rows are kept."""
    scenario = load_preset("paper").replace(
        {"controller.kind": "none", "gravity": 9.81, "initial.pose": (0.05, 0.9, 0)}
    )
    run = simulate(scenario, 3.0)
    assert run.status.failed
    assert run.status.time == run.time[-1]
    assert 10 < len(run) < 3000
    commanded = simulate(scenario, 3.0, commands=[(2.0, ChangeScenario({"gravity": 0.0}))])
    assert np.array_equal(commanded.pose, run.pose)
