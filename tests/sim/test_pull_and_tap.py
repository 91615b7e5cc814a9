"""A spring (pull) and a hammer (tap) on the beam."""

import numpy as np
import pytest

from flexlab.errors import ScenarioError
from flexlab.physics.plant import ETA
from flexlab.presets import load_preset
from flexlab.sim.build import payload_row
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

FREE = {"controller.kind": "none", "payload.damping.coefficient": 0.0}


def moving_world(**changes) -> World:
    """The paper's world in the middle of its start-up."""
    world = World(load_preset("paper").replace(changes))
    world.advance(23)
    return world


def point(world: World, samples: Samples, s: float) -> np.ndarray:
    """Position (N, 2) of the beam's material point s."""
    w = samples.beam_coordinates @ payload_row(world.scenario.payload, s)
    c, sine = np.cos(samples.pose[:, 2]), np.sin(samples.pose[:, 2])
    return samples.pose[:, :2] + np.stack([s * c - w * sine, s * sine + w * c], axis=1)


def velocity(world: World, samples: Samples, s: float) -> np.ndarray:
    """Velocity (N, 2) of that point, by differentiating its position along the motion."""
    h = 1e-6
    signals = {name: getattr(samples, name) for name in samples.__dataclass_fields__}
    ends = []
    for sign in (1, -1):
        moved = signals | {
            "pose": samples.pose + sign * h * samples.pose_rate,
            "beam_coordinates": samples.beam_coordinates + sign * h * samples.beam_rates,
        }
        ends.append(point(world, Samples(**moved), s))
    return (ends[0] - ends[1]) / (2 * h)


@pytest.mark.parametrize("at", [-0.25, -0.1, 0.0, 0.13, 0.25])
def test_a_tap_changes_momenta_by_exactly_the_impulse(at: float):
    """Δ(P, π) = (∂R/∂(x, η))ᵀ impulse, the derivative by differences of the point's position; coordinates stay."""
    world, impulse = moving_world(), np.array([0.7, -1.1])
    before = world.state().y
    n = len(world.beam.modes.omega)
    sample = world.observe()
    world.apply(Tap(at, tuple(impulse)))
    change = world.state().y - before
    h = 1e-6
    for k, index in enumerate([0, 1, 2, *range(ETA, ETA + n)]):
        q = sample.beam_coordinates.copy()
        pose = sample.pose.copy()
        ends = []
        for sign in (1, -1):
            moved_pose, moved_q = pose.copy(), q.copy()
            if k < 3:
                moved_pose[0, k] += sign * h
            else:
                moved_q[0] += sign * h * world.beam.modes.V[:, k - 3]
            signals = {name: getattr(sample, name) for name in sample.__dataclass_fields__}
            ends.append(point(world, Samples(**signals | {"pose": moved_pose, "beam_coordinates": moved_q}), at)[0])
        expected = (ends[0] - ends[1]) @ impulse / (2 * h)
        momentum = 3 + k if k < 3 else index + n
        assert change[momentum] == pytest.approx(expected, abs=1e-8)
        assert change[index] == 0


@pytest.mark.parametrize("at", [-0.1, 0.2])
def test_a_tap_does_the_work_of_an_impulse(at: float):
    """ΔT = impulse · (velocity of the point before + after)/2, and no other energy changes."""
    world, impulse = moving_world(), np.array([0.4, 0.9])
    before = world.observe()
    world.apply(Tap(at, tuple(impulse)))
    after = world.observe()
    mean = (velocity(world, before, at)[0] + velocity(world, after, at)[0]) / 2
    assert after.kinetic_energy[0] - before.kinetic_energy[0] == pytest.approx(impulse @ mean, rel=1e-7)
    assert after.elastic_energy[0] == before.elastic_energy[0]


def test_all_integrators_agree_on_the_motion_after_a_tap():
    """They agree on the next 20 ms, from rest and without control, with steps of 10 µs for the highest modes."""
    runs = []
    for integrator in ("rk4", "etdrk4", "generalized-alpha"):
        changes = {**FREE, "simulation.integrator": integrator, "simulation.step": 1e-5}
        world = World(load_preset("paper").replace(changes))
        world.apply(Tap(0.1, (0.2, 0.3)))
        runs.append(world.run(20))
    assert np.abs(runs[0].midspan_deflection).max() > 1e-3
    for other in runs[1:]:
        np.testing.assert_allclose(other.pose, runs[0].pose, rtol=0, atol=5e-7)
        np.testing.assert_allclose(other.beam_coordinates, runs[0].beam_coordinates, rtol=0, atol=2e-4)


def test_a_pull_is_a_spring_from_the_point_to_the_target():
    """With motors off, the sum of energy and ½k d² is constant; the point swings about the target."""
    at, target, stiffness = -0.08, np.array([0.05, 0.8]), 900.0
    world = World(load_preset("paper").replace({**FREE, "simulation.step": 1e-4}))
    world.apply(Pull(at, tuple(target), stiffness))
    samples = world.run(1500)
    assert world.status == "running", world.status.text
    distance = target - point(world, samples, at)
    spring = stiffness / 2 * np.sum(distance**2, axis=1)
    total = samples.total_energy + spring
    assert np.ptp(spring) > 0.9 * spring[0]
    np.testing.assert_allclose(total, total[0], rtol=0, atol=1e-7 * total[0])
    assert np.all(distance.min(axis=0) < 0)
    assert np.all(distance.max(axis=0) > 0)


def test_letting_go_ends_the_force():
    """At stiffness 0 the acceleration changes at once, and no more work is done."""
    world = World(load_preset("paper").replace(FREE))
    world.apply(Pull(0.1, (0.2, 0.9), 500.0))
    world.advance(50)
    pulled = world.observe()
    world.apply(Pull(0.1, (0.2, 0.9), 0.0))
    free = world.observe()
    assert np.abs(free.pose_acceleration - pulled.pose_acceleration).max() > 0.1
    later = world.advance(50)
    np.testing.assert_allclose(later.input_work, free.input_work[0], rtol=0, atol=1e-12)


def test_a_pull_stays_on_its_point_across_a_new_mesh():
    """The mesh changes from 2 to 6 elements during the pull, which goes on at the same place."""
    world = moving_world(**FREE)
    world.apply(Pull(0.11, (0.1, 1.0), 700.0))
    world.advance(5)
    before = world.observe().pose_acceleration[0]
    world.apply(ChangeScenario({"payload.element_count": 6}))
    samples = world.run(200)
    distance = np.array([0.1, 1.0]) - point(world, samples, 0.11)
    total = samples.total_energy + 350 * np.sum(distance**2, axis=1)
    np.testing.assert_allclose(total, total[0], rtol=1e-4)
    assert np.abs(before).max() > 1


def test_a_pull_outlasts_a_change_of_gain_in_a_run_whose_step_was_halved():
    """Beam and plant are shared with the assembly before the halving, which knows of no pull."""
    scenario = load_preset("paper").replace({"payload.bending_stiffness": 3000.0})
    held, changed = World(scenario), World(scenario)
    assert held._motion.assembly.unrefined is not None
    for world in (held, changed):
        world.advance(10)
        world.apply(Pull(-0.05, (-0.3, 0.7), 40.0))
        world.advance(10)
    changed.apply(ChangeScenario({"controller.feedback_gain": scenario.controller.feedback_gain}))
    np.testing.assert_array_equal(changed.state().pull, held.state().pull)
    np.testing.assert_allclose(changed.run(20).pose, held.run(20).pose, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (Tap(0.3, (1.0, 0.0)), "beam position = 0.3 m"),
        (Tap(float("nan"), (1.0, 0.0)), "beam position"),
        (Tap(0.0, (1e9, 0.0)), "tap"),
        (Tap(0.0, (float("nan"), 0.0)), "tap"),
        (Pull(-0.26, (0.0, 1.0), 10.0), "beam position = −0.26 m"),
        (Pull(0.0, (0.0, 1.0), -1.0), "stiffness"),
        (Pull(0.0, (0.0, 1.0), float("inf")), "stiffness"),
        (Pull(0.0, (float("nan"), 1.0), 10.0), "target"),
    ],
    ids=str,
)
def test_senseless_pulls_and_taps_are_refused_by_name(command, words: str, same_bits):
    """One sentence names the quantity at fault, and the run goes on as if nothing had been asked."""
    world = moving_world()
    with pytest.raises(ScenarioError) as refusal:
        world.apply(command)
    assert words in str(refusal.value)
    same_bits(world.run(20), moving_world().run(20))
