"""Runs that cannot start or go on have a status with a sentence and the last good state, and never show NaN."""

from dataclasses import fields

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World


def paper(**changes) -> Scenario:
    return load_preset("paper").replace(changes)


def all_finite(samples: Samples) -> bool:
    return all(bool(np.isfinite(getattr(samples, f.name)).all()) for f in fields(Samples))


def test_an_unreachable_trajectory_is_found_before_the_run():
    """The sentence says which arm, where, when, by how much, and what to do. At (0.8, 1) only the left wrist is too far."""
    run = simulate(paper(**{"trajectory.center": (0.5, 1.0, 0.0), "trajectory.amplitude": (0.3, 0.0, 0.0)}), 1.0)
    assert run.status == "unreachable"
    assert len(run) == 1
    assert "left arm" in run.status.text
    for words in ("x = ", "y = 1.000 m", "t = ", "beyond the 1.300 m", "smaller"):
        assert words in run.status.text
    # The sentence's numbers are right: the wrist is at x - 0.45 m, the base at (-0.5, 0).
    x = float(run.status.text.split("x = ")[1].split(" m")[0])
    distance = float(run.status.text.split("would be ")[1].split(" m")[0])
    assert distance == pytest.approx(np.hypot(x - 0.45 + 0.5, 1.0), abs=2e-3)
    assert distance > 1.3
    assert all_finite(run)


def test_the_right_arm_is_named_when_it_is_the_one_out_of_reach():
    """Mirror image of the case above."""
    world = World(paper(**{"trajectory.center": (-0.5, 1.0, 0.0), "trajectory.amplitude": (0.3, 0.0, 0.0)}))
    assert world.status == "unreachable"
    assert "right arm" in world.status.text


def test_a_wrist_too_near_its_base_is_unreachable_too():
    """Link lengths 0.7 and 0.6 leave a hole of 0.1 m about the base."""
    world = World(paper(**{"trajectory.center": (-0.02, 0.05, 0.0), "trajectory.amplitude": (0.0, 0.0, 0.0)}))
    assert world.status == "unreachable"
    assert "short of the 0.100 m" in world.status.text


def test_a_stretched_arm_is_singular():
    """Wrist 1.29995 m from the base: within reach, but the elbow's sine is below its limit."""
    height = np.sqrt(1.29995**2 - 0.05**2)
    world = World(paper(**{"trajectory.center": (0.0, height, 0.0), "trajectory.amplitude": (0.0, 0.0, 0.0)}))
    assert world.status == "singular"
    assert "arm is stretched" in world.status.text


def test_an_unreachable_start_pose_is_named():
    """The trajectory can be reached, the start pose cannot."""
    world = World(paper(**{"initial.pose": (0.9, 1.2, 0.0)}))
    assert world.status == "unreachable"
    assert "the start pose" in world.status.text
    assert len(world.advance(10)) == 0
    assert all_finite(world.observe())


@pytest.mark.parametrize("frequency", [(1.0, 1.0, 1.0), (1.0, 1.7, 0.3), (0.05, 2.0, 0.7)])
def test_the_whole_trajectory_is_checked(frequency: tuple[float, ...]):
    """The extreme pose comes late in the period and is still found before the first step."""
    world = World(paper(**{"trajectory.amplitude": (0.5, 0.5, 0.0), "trajectory.frequency": frequency}))
    assert world.status in ("unreachable", "singular")
    assert world.status.time > 0


def test_an_arm_that_falls_out_of_its_workspace_stops_the_run():
    """Motors are off under gravity. Samples are good up to the stop, the last good state is kept, and the arm is named."""
    scenario = paper(**{"controller.kind": "none", "gravity": 9.81, "initial.pose": (0.05, 0.9, 0.0)})
    world = World(scenario)
    samples = world.run(3000)
    assert world.status in ("singular", "unreachable")
    assert 10 < len(samples) < 3000
    assert all_finite(samples)
    assert "arm left its workspace" in world.status.text
    assert f"t = {samples.time[-1]:.3f} s" in world.status.text
    assert np.array_equal(world.observe().pose, samples.pose[-1:])
    assert len(world.advance(5)) == 0


def test_motors_that_are_off_are_named():
    """No gain and no amplitude can hold an arm that falls freely."""
    world = World(paper(**{"controller.kind": "none", "gravity": 9.81, "initial.pose": (0.05, 0.9, 0.0)}))
    world.run(3000)
    assert "arm left its workspace" in world.status.text
    assert "The motors are off (controller.kind = none)" in world.status.text
    assert "gains" not in world.status.text


def test_noise_that_throws_the_measured_pose_out_of_reach_is_named():
    """The arms are well within their workspace; the pose that the controller measures is not."""
    noise = {"controller.control_period": 0.001, "controller.sensor_noise.pose": (0.1, 0.1, 0.0)}
    world = World(paper(**noise))
    world.run(3000)
    assert world.status in ("unreachable", "singular")
    assert "sensor noise threw the measured pose out of the workspace" in world.status.text
    assert "less noise in controller.sensor_noise.pose" in world.status.text
    assert "gains" not in world.status.text


@pytest.mark.parametrize(
    "changes",
    [
        {"controller.control_period": 0.1},
        {"controller.control_period": 0.02},
        {"controller.kind": "pd", "controller.control_period": 0.05},
        {"controller.feedback_gain": 1e5, "controller.control_period": 0.001},
    ],
    ids=str,
)
def test_an_unstable_sampled_loop_asks_for_a_shorter_control_period(changes: dict):
    """Neither higher gains nor a shorter step would help."""
    world = World(paper(**changes))
    world.run(400)
    assert world.status.failed
    assert "sampled control loop ran away" in world.status.text
    assert f"control period of {changes['controller.control_period']:g} s" in world.status.text
    assert "shorter control period or lower gains" in world.status.text
    assert "last good state" in world.status.text
    for wrong in ("higher gains", "shorter step", "simulation.step"):
        assert wrong not in world.status.text


ABSURD = {
    "gain with a step too long for it": {"controller.feedback_gain": 1e6, "simulation.step": 1e-3},
    "gain, second order": {
        "controller.feedback_gain": 1e6,
        "simulation.step": 1e-3,
        "simulation.integrator": "generalized-alpha",
    },
    "long step, many elements": {
        "payload.element_count": 16,
        "payload.linear_density": 100.0,
        "simulation.step": 1e-3,
        "payload.bending_stiffness": 1e5,
    },
    "slow sampling": {"controller.control_period": 0.1},
    "pd with slow sampling": {"controller.kind": "pd", "controller.control_period": 0.05},
    "vibration gain": {
        "controller.kind": "vibration-damping",
        "controller.lateral_vibration_gain": 1e5,
        "simulation.step": 1e-3,
    },
}


@pytest.mark.parametrize("changes", ABSURD.values(), ids=ABSURD)
def test_divergence_keeps_the_last_good_state(changes: dict):
    """Absurd gains and steps end in a failed status with a sentence; every sample handed out is finite."""
    world = World(paper(**changes))
    samples = world.run(400)
    assert world.status.failed
    assert world.status in ("diverged", "unreachable", "singular")
    assert world.status.text.endswith(".")
    assert "last good state" in world.status.text
    assert len(samples) < 400
    assert all_finite(samples)
    last = world.observe()
    assert all_finite(last)
    assert np.array_equal(last.pose[0], samples.pose[-1])
    assert np.array_equal(last.beam_coordinates[0], samples.beam_coordinates[-1])
    assert world.time == samples.time[-1]


def test_a_beam_bent_by_more_than_its_length_stops_the_run():
    """The linear model means nothing for a beam bent so far."""
    world = World(paper(**{"payload.bending_stiffness": 0.01, "trajectory.frequency": (3.0, 3.0, 3.0)}))
    samples = world.run(2000)
    assert world.status == "diverged"
    assert "deflection" in world.status.text
    assert np.abs(samples.midspan_deflection).max() < 0.5


def test_a_failed_world_can_be_started_anew():
    """A change of the start state restarts even a failed world."""
    world = World(paper(**{"initial.pose": (0.9, 1.2, 0.0)}))
    assert world.apply(ChangeScenario({"initial.pose": None})) is True
    assert world.status == "running"
    assert len(world.advance(10)) == 10


@pytest.mark.parametrize("integrator", ["rk4", "etdrk4", "generalized-alpha"])
@pytest.mark.parametrize(
    "damping",
    [
        {"kind": "nodal", "coefficient": 2.0},
        {"kind": "nodal", "coefficient": 50.0},
        {"kind": "stiffness", "coefficient": 2e-3},
        {"kind": "stiffness", "coefficient": 0.1},
        {"kind": "modal", "ratio": 0.2},
        {"kind": "modal", "ratio": 2.0},
    ],
    ids=str,
)
def test_no_damping_makes_an_automatic_step_unstable(integrator: str, damping: dict):
    """Every damping that a slider or a file can ask for runs with every integrator's automatic step."""
    world = World(paper(**{"payload.damping": damping, "simulation.integrator": integrator}))
    samples = world.run(30)
    assert world.status == "running", world.status.text
    assert np.abs(samples.midspan_deflection).max() < 3e-3


@pytest.mark.parametrize("integrator", ["rk4", "etdrk4", "generalized-alpha"])
@pytest.mark.parametrize("n", [2, 8])
@pytest.mark.parametrize("density", [0.01, 20.0, 1000.0])
def test_no_payload_makes_an_automatic_step_unstable(integrator: str, n: int, density: float):
    """Beams may be light or heavy, at the paper's frequencies: the automatic step allows for arms that give way."""
    changes = {"payload.linear_density": density, "payload.bending_stiffness": 50 * density}
    world = World(paper(**changes, **{"payload.element_count": n, "simulation.integrator": integrator}))
    world.run(30)
    assert world.status == "running", world.status.text


def test_a_free_end_bent_by_more_than_the_beams_length_stops_the_run():
    """A limp beam in one arm, bent like a parabola: its end is 0.6 m off its axis, its middle only 0.15 m."""
    arm = load_preset("single-arm").replace({"payload.bending_stiffness": 0.01, "payload.element_count": 2})
    length = arm.payload.length
    shape = [(0.6 * (s / length) ** 2, 1.2 * s / length**2) for s in (length / 2, length)]
    world = World(arm.replace({"initial.beam_coordinates": [value for node in shape for value in node]}))
    assert abs(float(world.observe().midspan_deflection[0])) == pytest.approx(0.15)
    world.advance(5)
    assert world.status == "diverged"
    assert "deflection of its free end exceeded the beam's length" in world.status.text
    assert all_finite(world.observe())
