"""What a live change keeps, and what it changes."""

import numpy as np
import pytest

from flexlab.control.path import paths
from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.geometry import deflection_at
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

CONTINUOUS = [
    {"payload.bending_stiffness": 10.0},
    {"payload.bending_stiffness": 1e9},
    {"payload.linear_density": 5.0},
    {"payload.damping": {"kind": "modal", "ratio": 0.05}},
    {"payload.damping.coefficient": 2.0},
    {"controller.feedback_gain": 500.0, "controller.sliding_slope": (20.0, 30.0, 40.0)},
    {"controller.adaptation": (1.0, 1.0, 1.0)},
    {"controller.kind": "computed-torque"},
    {"controller.kind": "pd"},
    {"controller.kind": "none"},
    {"controller.kind": "vibration-damping"},
    {"controller.model.linear_density_factor": 0.5},
    {"controller.torque_limit": (50.0, 50.0, 50.0)},
    {"controller.control_period": 0.002},
    {"gravity": 9.81},
    {"trajectory.amplitude": (0.1, 0.05, 0.3)},
    {"trajectory.frequency": (2.0, 0.5, 1.0)},
    {"trajectory.center": (0.05, 0.8, 0.1)},
    {"simulation.integrator": "rk4"},
    {"simulation.integrator": "generalized-alpha"},
    {"simulation.step": 1e-4},
]


def ringing_world(**changes) -> World:
    """The paper's world 37 ms after its jerk: moving fast, ringing hard."""
    world = World(load_preset("paper").replace(changes))
    world.advance(37)
    assert np.abs(world.observe().beam_rates).max() > 0.1
    return world


def motion(samples: Samples) -> np.ndarray:
    """Pose, its rate, q, q̇ of one sample."""
    signals = ("pose", "pose_rate", "beam_coordinates", "beam_rates")
    return np.concatenate([getattr(samples, name)[0] for name in signals])


@pytest.mark.parametrize("changes", CONTINUOUS, ids=str)
@pytest.mark.parametrize("integrator", ["etdrk4", "generalized-alpha"])
def test_motion_is_continuous_across_a_live_change(changes: dict, integrator: str):
    """Pose, rate, q, q̇ and b̂ are the same before and after to 1e-12; time goes on, and the change is in force.

    Only a controller that becomes a sampled one acts at that instant, and its b̂ makes a step of its own.
    """
    world = ringing_world(**{"simulation.integrator": integrator})
    before, tick = world.observe(), world.tick
    assert world.apply(ChangeScenario(changes)) is False
    after = world.observe()
    np.testing.assert_allclose(motion(after), motion(before), rtol=0, atol=1e-12)
    if "controller.control_period" not in changes:
        np.testing.assert_array_equal(after.bound_estimates, before.bound_estimates)
    assert (world.tick, world.status) == (tick, "running")
    for path, value in changes.items():
        found = world.scenario.get(path)
        assert (found.model_dump() if hasattr(found, "model_dump") else found) == value
    assert len(world.advance(50)) == 50, world.status.text


def test_a_change_acts_at_once():
    """Half the stiffness gives half the elastic energy in the same shape, and another motion three samples later."""
    plain, changed = ringing_world(), ringing_world()
    changed.apply(ChangeScenario({"payload.bending_stiffness": 50.0}))
    assert changed.first_frequency == pytest.approx(plain.first_frequency / np.sqrt(2))
    assert changed.observe().elastic_energy[0] == pytest.approx(plain.observe().elastic_energy[0] / 2)
    assert np.abs(changed.advance(3).beam_rates[-1] - plain.advance(3).beam_rates[-1]).max() > 0.01


def test_a_changed_frequency_does_not_jump_the_target():
    """x_d is continuous: the sine keeps its argument, its rate changes."""
    world = World(load_preset("paper"))
    world.advance(1337)
    before = world.observe()
    world.apply(ChangeScenario({"trajectory.frequency": (2.5, 0.3, 1.0)}))
    np.testing.assert_allclose(world.observe().desired_pose, before.desired_pose, rtol=0, atol=1e-12)
    slow = world.advance(1).desired_pose[0] - before.desired_pose[0]
    angle = 2 * np.pi * 1.337
    np.testing.assert_allclose(slow, 0.2 * 2 * np.pi * np.array([2.5, 0.3, 1]) * np.cos(angle) * 1e-3, rtol=0.05)


def test_a_phase_given_together_with_a_frequency_is_taken_as_given():
    """Only a change of the frequency alone shifts the phase; a replay that gives both means both."""
    world = World(load_preset("paper"))
    world.advance(333)
    whole = {
        "kind": "sine",
        "center": (0, 0.75, 0),
        "amplitude": (0.1,) * 3,
        "frequency": (2,) * 3,
        "phase": (0.5,) * 3,
    }
    world.apply(ChangeScenario({"trajectory": whole}))
    assert world.scenario.trajectory.phase == (0.5, 0.5, 0.5)
    world.apply(ChangeScenario({"trajectory.frequency": (1.0,) * 3, "trajectory.phase": (0.2,) * 3}))
    assert world.scenario.trajectory.phase == (0.2, 0.2, 0.2)


STRUCTURES = [
    [{"payload.element_count": n} for n in (3, 8, 5, 2, 64, 16)],
    [{"payload.boundary": b} for b in ("clamped-clamped", "pinned-pinned", "clamped-pinned", "pinned-clamped")],
    [{"payload.element_count": 8, "payload.boundary": "clamped-clamped"}, {"payload.element_count": 3}],
]


@pytest.mark.parametrize("steps", STRUCTURES, ids=["meshes", "boundaries", "both"])
@pytest.mark.parametrize("integrator", ["etdrk4", "generalized-alpha"])
def test_mid_span_deflection_is_continuous_across_a_new_mesh(steps: list[dict], integrator: str):
    """For n ≥ 2, w(0) and its rate agree to 1e-6, pose, rate and b̂ to 1e-12; the run goes on."""
    world = ringing_world(**{"simulation.integrator": integrator})
    if steps is STRUCTURES[0]:
        world.apply(ChangeScenario({"simulation.step": 2.5e-4}))  # 64 elements at 10 µs would only cost time
    for changes in steps:
        before, payload = world.observe(), world.scenario.payload
        rate = deflection_at(payload, before.beam_rates, np.zeros(1))[0, 0]
        tick = world.tick
        assert world.apply(ChangeScenario(changes)) is True, "other coordinates: a new run begins for whoever records"
        assert world.tick == tick, "time goes on"
        after = world.observe()
        assert abs(after.midspan_deflection[0] - before.midspan_deflection[0]) < 1e-6
        new_rate = deflection_at(world.scenario.payload, after.beam_rates, np.zeros(1))[0, 0]
        assert new_rate == pytest.approx(rate, abs=1e-9)
        np.testing.assert_allclose(after.pose, before.pose, rtol=0, atol=1e-12)
        np.testing.assert_allclose(after.pose_rate, before.pose_rate, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(after.bound_estimates, before.bound_estimates)
        assert len(world.advance(7)) == 7, world.status.text


def test_a_finer_mesh_keeps_the_whole_shape():
    """n = 2 → 8: the coarse shape lies in the fine space, so it is kept everywhere, and with it its energy.

    8 → 2 → 8 does not keep the shape.
    """
    world = ringing_world()
    place = np.linspace(-0.25, 0.25, 41)
    coarse = deflection_at(world.scenario.payload, world.observe().beam_coordinates, place)
    energy = world.observe().elastic_energy[0]
    world.apply(ChangeScenario({"payload.element_count": 8}))
    fine = deflection_at(world.scenario.payload, world.observe().beam_coordinates, place)
    np.testing.assert_allclose(fine, coarse, rtol=0, atol=1e-12)
    assert world.observe().elastic_energy[0] == pytest.approx(energy, rel=1e-9)
    world.advance(5)
    before = deflection_at(world.scenario.payload, world.observe().beam_coordinates, place)
    for count in (2, 8):
        world.apply(ChangeScenario({"payload.element_count": count}))
    after = deflection_at(world.scenario.payload, world.observe().beam_coordinates, place)
    assert np.abs(after - before).max() > 1e-6


RESTARTS = [
    {"payload.length": 0.4},
    {"left_arm.base": (-0.55, 0.0)},
    {"right_arm.link_mass": (5.0, 5.0, 2.0)},
    {"initial.pose_rate": None},
    {"payload.boundary": "clamped-free", "right_arm": None},
]


@pytest.mark.parametrize("changes", RESTARTS, ids=str)
def test_a_change_after_which_the_motion_cannot_go_on_begins_a_new_run(changes: dict):
    """Changes of length, arms or start state do, and it begins at t = 0."""
    world = ringing_world()
    assert world.apply(ChangeScenario(changes)) is True
    assert (world.tick, world.time, world.status) == (0, 0.0, "running")
    assert world.scenario == load_preset("paper").replace(changes)


REFUSED = [
    {"payload.bending_stiffness": -1.0},
    {"payload.bending_stiffness": float("nan")},
    {"payload.element_count": 1e9},
    {"payload.length": 1e9},
    {"controller.kind": "magic"},
    {"no.such.field": 1},
    {"trajectory.amplitude": (1.5, 1.5, 0.2)},
    {"trajectory.center": (5.0, 5.0, 0.0)},
    {"left_arm.base": (-5.0, 0.0)},
    {"initial.pose": (3.0, 3.0, 0.0)},
    {"controller.control_period": 0.0001234567},
    {"payload.boundary": "clamped-free"},
    {"simulation.integrator": "rk4", "simulation.step": 0.01},
    {"payload.length": 0.06, "simulation.integrator": "rk4", "simulation.step": 4e-4},
]


@pytest.mark.parametrize("changes", REFUSED, ids=str)
def test_a_refused_change_leaves_the_world_as_it_was(changes: dict, same_bits):
    """It gives one clear sentence, and the run goes on bit for bit as if nothing had been asked."""
    world, untouched = ringing_world(), ringing_world()
    scenario = world.scenario
    with pytest.raises(ScenarioError) as refusal:
        world.apply(ChangeScenario(changes))
    text = str(refusal.value)
    assert text.endswith(".")
    assert len(text) < 500
    assert world.scenario == scenario
    assert world.tick == 37
    same_bits(world.run(30), untouched.run(30))


@pytest.mark.parametrize(
    "change",
    [
        {"payload.bending_stiffness": 50.0},
        {"payload.damping.coefficient": 0.5},
        {"left_arm.link_mass": (9.0, 5.0, 2.0)},
        {"controller.feedback_gain": 300.0},
        {"gravity": 9.81},
        {"joints.friction.viscous": (50.0, 20.0, 5.0)},
        {"joints.friction.coulomb": (50.0, 20.0, 5.0)},
    ],
)
def test_a_shaper_without_numbers_follows_the_loop_as_in_a_run_that_begins_anew(change: dict):
    world = World(load_preset("sudden-stop").replace({"trajectory.shaper": "zvd"}))
    before = world.assembly.system.trajectory.impulses
    world.apply(ChangeScenario(change))
    after, anew = (each.assembly.system.trajectory.impulses for each in (world, World(world.scenario)))
    assert not np.array_equal(before, anew)
    assert np.array_equal(after, anew)


@pytest.mark.parametrize("kind", [path.kind for path in paths().values() if path.kind not in ("sine", "table")])
def test_a_path_chosen_in_a_spin_goes_on_from_the_turn_reached(kind: str):
    """At 9.6 turns, nobody wants to see the beam unwind them, and the poses of all turns are allowed."""
    world = World(load_preset("spin-up"))
    world.advance(6500)
    before = world.run(1).desired_pose[-1, 2]
    world.apply(ChangeScenario({"trajectory.kind": kind}))
    samples = world.run(1000)
    assert before > 60
    assert np.abs(samples.desired_pose[:, 2] - before).max() < 2 * np.pi
    assert np.abs(samples.tracking_error).max() < 2e-3


@pytest.mark.parametrize("kind", ["hold", "rest-to-rest", "bang-bang"])
@pytest.mark.parametrize("restart", [{}, {"left_arm.base": (-0.6, 0.0)}])
def test_a_path_that_would_begin_outside_its_range_is_refused(kind: str, restart: dict, same_bits):
    """Such a path is derived from the present target, which nothing has checked; a recording of it could not be read."""
    turned = {"trajectory.center": (0.0, 0.75, 32 * np.pi - 0.9), "trajectory.amplitude": (0.0, 0.0, 0.6)}
    world, other = (World(load_preset("paper").replace(turned)) for _ in range(2))
    world.advance(250)
    with pytest.raises(ScenarioError, match=r"100\.2.* outside the allowed range −100 to 100"):
        world.apply(ChangeScenario({"trajectory.kind": kind, **restart}))
    assert world.scenario == other.scenario
    other.advance(250)
    same_bits(world.run(20), other.run(20))
