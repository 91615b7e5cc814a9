"""The desired motions and their rates."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexlab.analysis.replay import replay
from flexlab.control.path import paths
from flexlab.presets import load_preset, load_scenario_file, read_scenario, save_scenario, scenario_text
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.scenario import Scenario, parse_scenario
from flexlab.server.scenario_links import decode_scenario, encode_scenario
from flexlab.sim.advance import advance
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.target import build_trajectory, desired_at
from flexlab.sim.termination import check_trajectory
from flexlab.sim.world import World

three = st.tuples(*[st.floats(-3, 3)] * 3)


@settings(max_examples=100)
@given(center=three, amplitude=three, phase=three, frequency=st.tuples(*[st.floats(0, 5)] * 3), t=st.floats(0, 20))
def test_rates_are_the_derivatives_of_the_motion(center, amplitude, phase, frequency, t):
    """x_d = center + amplitude sin(2πft + phase); ẋ_d and ẍ_d by differences; equal and unequal frequencies."""
    path = {"center": center, "amplitude": amplitude, "frequency": frequency, "phase": phase}
    sine = build_trajectory(Scenario().replace({f"trajectory.{name}": value for name, value in path.items()}))
    h = 1e-4
    before, now, after = (desired_at(sine, t + k * h) for k in (-1, 0, 1))
    angle = 2 * np.pi * np.array(frequency) * t + phase
    np.testing.assert_allclose(now[0], np.array(center) + np.array(amplitude) * np.sin(angle), rtol=0, atol=1e-12)
    np.testing.assert_allclose(now[1], (after[0] - before[0]) / (2 * h), rtol=0, atol=2e-4)
    np.testing.assert_allclose(now[2], (after[1] - before[1]) / (2 * h), rtol=0, atol=1e-2)


def test_components_share_a_sine_only_if_frequency_and_phase_are_equal():
    """One component's sine may stand for another's only if frequency and phase are the same."""
    equal = {"trajectory.frequency": (1.3, 1.3, 1.3), "trajectory.phase": (0.2, 0.2, 0.2)}
    mixed = {"trajectory.frequency": (1.3, 0.7, 1.3), "trajectory.phase": (0.2, 0.2, 0.9)}
    for changes in (equal, mixed):
        scenario = Scenario().replace(changes)
        path = scenario.trajectory
        found = desired_at(build_trajectory(scenario), 0.77)[0]
        angle = 2 * np.pi * np.array(path.frequency) * 0.77 + path.phase
        np.testing.assert_allclose(found, path.center + 0.2 * np.sin(angle), rtol=0, atol=1e-14)


ALTERED = {
    "trajectory.smooth_start": 0.3,
    "trajectory.shaper": "zvd",
    "trajectory.shaper_frequency": 7.0,
    "trajectory.shaper_damping": 0.02,
}
TURNED = {
    "sine": {"frequency": 0.7, "phase": 0.4, "amplitude": 0.1},
    "circle": {"phase": 1.0},
    "figure-eight": {"phase": 1.0},
}


def on(kind: str, **changes: Any) -> Scenario:
    """The paper's scenario on another path, with phases at which nothing is zero by chance."""
    own = {"kind": kind, **TURNED.get(kind, {}), **changes}
    return load_preset("paper").replace({"trajectory": own})


@pytest.mark.parametrize("altered", [{}, ALTERED], ids=["plain", "altered"])
@pytest.mark.parametrize("kind", paths())
def test_every_paths_rates_are_derivatives(kind: str, altered: dict):
    """By central differences, wherever the acceleration has no jump within them."""
    motion, h = build_trajectory(on(kind).replace(altered)), 1e-5
    for t in np.linspace(0.0137, 1.3, 61):
        before, now, after = (desired_at(motion, t + k * h) for k in (-1, 0, 1))
        np.testing.assert_allclose(now[1], (after[0] - before[0]) / (2 * h), rtol=0, atol=1e-6)
        if np.abs(after[2] - before[2]).max() < 0.1:
            np.testing.assert_allclose(now[2], (after[1] - before[1]) / (2 * h), rtol=0, atol=1e-4)


@pytest.mark.parametrize("kind", paths())
def test_extent_peak_acceleration_and_end_of_a_path_are_as_it_says(kind: str):
    path, motion = on(kind).trajectory, build_trajectory(on(kind))
    seen = np.array([desired_at(motion, t) for t in np.linspace(*path.window, 4001)])
    middle, reach = np.array(path.middle), np.array(path.reach)
    np.testing.assert_allclose(seen[:, 0].max(axis=0), middle + reach, rtol=0, atol=1e-5)
    np.testing.assert_allclose(seen[:, 0].min(axis=0), middle - reach, rtol=0, atol=1e-5)
    np.testing.assert_allclose(np.abs(seen[:, 2]).max(axis=0), path.peak_acceleration, rtol=1e-3, atol=1e-9)
    if path.end is None:
        np.testing.assert_allclose(desired_at(motion, path.span + 0.3), desired_at(motion, 0.3), rtol=0, atol=1e-9)
        return
    last = desired_at(motion, path.end)[0]
    for t in (path.end + 1e-9, path.end + 0.1, path.end + 1e4):
        np.testing.assert_array_equal(desired_at(motion, t), [last, [0] * 3, [0] * 3])


@pytest.mark.parametrize(("kind", "at_a_quarter"), [("rest-to-rest", 53 / 512), ("bang-bang", 1 / 8)])
def test_motions_from_rest_to_rest_pass_the_right_poses(kind: str, at_a_quarter: float):
    """Before the start, after a quarter and half of the duration, and after the end."""
    scenario = on(kind, **{"from": (0.1, 0.7, 0.2), "to": (-0.1, 0.8, -0.1), "start": 0.5, "duration": 0.8})
    motion, way = build_trajectory(scenario), np.array([-0.2, 0.1, -0.3])
    np.testing.assert_array_equal(desired_at(motion, 0.3), [[0.1, 0.7, 0.2], [0] * 3, [0] * 3])
    np.testing.assert_allclose(desired_at(motion, 0.7)[0], (0.1, 0.7, 0.2) + at_a_quarter * way, rtol=0, atol=1e-15)
    np.testing.assert_allclose(desired_at(motion, 0.9)[0], (0.0, 0.75, 0.05), rtol=0, atol=1e-15)
    np.testing.assert_allclose(desired_at(motion, 1.4)[0], (-0.1, 0.8, -0.1), rtol=0, atol=1e-15)


def test_a_smooth_start_begins_at_rest_and_goes_the_same_way():
    plain, smooth = (build_trajectory(on("circle", smooth_start=ramp)) for ramp in (0.0, 0.6))
    first = desired_at(smooth, 0.0)
    np.testing.assert_array_equal(first, [desired_at(plain, 0.0)[0], [0] * 3, [0] * 3])
    np.testing.assert_allclose(desired_at(smooth, 0.6), desired_at(plain, 0.3), rtol=0, atol=1e-12)
    np.testing.assert_allclose(desired_at(smooth, 1.7), desired_at(plain, 1.4), rtol=0, atol=1e-12)


def test_the_start_velocity_may_be_that_of_the_path():
    run = simulate(on("circle").replace({"initial.pose_rate": None}), 0.01)
    np.testing.assert_allclose(run.pose_rate[0], desired_at(build_trajectory(on("circle")), 0.0)[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", ["sine", "circle", "figure-eight"])
@pytest.mark.parametrize("hertz", [5e-324, 1e-310, 1e-12])
def test_a_path_too_slow_to_repeat_in_a_lifetime_counts_as_resting(kind: str, hertz: float):
    far = load_preset("paper").replace({"trajectory.kind": kind, "trajectory.center": (0.0, 5e-324, 0.0)})
    slow = far.replace({"trajectory.frequency": hertz})
    assert slow.trajectory.span == 0
    assert slow.trajectory.slowest_period == 1.0
    assert check_trajectory(slow) is not None, "a fault, as no arm reaches this centre"


def test_a_path_that_names_no_kind_is_a_sine():
    """Files and recordings from before there were other paths name no kind."""
    old = parse_scenario({"trajectory": {"center": (0, 0.7, 0), "frequency": [2, 2, 2]}})
    assert (old.trajectory.kind, old.trajectory.frequency) == ("sine", (2.0, 2.0, 2.0))


def test_one_number_stands_for_three():
    three_times = {"amplitude": (0.1,) * 3, "frequency": (0.5,) * 3, "phase": (0.3,) * 3}
    once = {"amplitude": 0.1, "frequency": 0.5, "phase": 0.3}
    scenarios = [load_preset("paper").replace({"trajectory": {"kind": "sine", **one}}) for one in (once, three_times)]
    runs = [simulate(one, 0.2, commands=[(0.1, ChangeScenario({"trajectory.frequency": 2.0}))]) for one in scenarios]
    assert runs[0].pose.tobytes() == runs[1].pose.tobytes()


@pytest.mark.parametrize("kind", paths())
def test_every_path_is_replayed_bit_for_bit_and_shared(kind: str, tmp_path):
    scenario = on(kind).replace({**ALTERED, "trajectory.bending_feedforward": 0.5})
    recording = read_recording(write_run(simulate(scenario, 0.2), tmp_path, kind))
    assert recording.scenario == scenario
    assert replay(recording).identical
    assert decode_scenario(encode_scenario(scenario)) == scenario
    save_scenario(scenario, tmp_path / "own.json")
    assert load_scenario_file(tmp_path / "own.json") == scenario


CHANGES = [
    *({"trajectory.kind": kind} for kind in paths() if kind != "sine"),
    {"trajectory.amplitude": 0.1},
    {"trajectory.center": (0.05, 0.8, 0.1)},
    {"trajectory.phase": 1.0},
    {"trajectory.frequency": 0.5},
    {"trajectory.smooth_start": 1.0},
    {"trajectory.shaper": "ei-shaper"},
    {"trajectory": {"kind": "circle"}},
]


@pytest.mark.parametrize("changes", CHANGES, ids=str)
def test_the_target_does_not_jump_when_the_path_changes_in_motion(changes: dict):
    """Half a second after the change the target is on the new path."""
    world = World(load_preset("paper"))
    world.advance(333)
    before = desired_at(world.system.trajectory, world.time)
    assert world.apply(ChangeScenario(changes)) is False
    after = desired_at(world.system.trajectory, world.time)
    np.testing.assert_allclose(after[0], before[0], rtol=0, atol=1e-9)
    if "trajectory.frequency" not in changes:
        np.testing.assert_allclose(after[1:], before[1:], rtol=0, atol=1e-6)
    times = world.time + np.linspace(0, 0.6, 2401)
    way = np.array([desired_at(world.system.trajectory, t)[0] for t in times])
    assert np.abs(np.diff(way, axis=0)).max() < 5e-4, "0.25 ms at 2 m/s"
    new = build_trajectory(world.scenario.anew())
    for t in (world.time + 0.501, world.time + 3.0):
        np.testing.assert_array_equal(desired_at(world.system.trajectory, t), desired_at(new, t))
    assert len(world.advance(60)) == 60


def test_many_changes_in_a_row_do_not_make_the_target_jump():
    world = World(load_preset("paper"))
    sine = [{"trajectory.kind": "sine"}, {"trajectory.amplitude": 0.1}, {"trajectory.shaper": "zvd"}]
    others = [{"trajectory.kind": kind} for kind in ("circle", "rest-to-rest", "hold")]
    for changes in (*sine, others[0], {"trajectory.radius": 0.05}, others[1], {"trajectory.duration": 0.2}, others[2]):
        world.advance(31)
        before = desired_at(world.system.trajectory, world.time)
        world.apply(ChangeScenario(changes))
        np.testing.assert_allclose(desired_at(world.system.trajectory, world.time)[0], before[0], rtol=0, atol=1e-9)


def test_a_new_run_ignores_a_change_made_in_motion():
    world = World(load_preset("paper"))
    world.advance(100)
    world.apply(ChangeScenario({"trajectory.center": (0.05, 0.8, 0.1)}))
    assert world.scenario.trajectory.transition is not None
    fresh = simulate(world.scenario, 0.15)
    assert fresh.pose.tobytes() == simulate(world.scenario.anew(), 0.15).pose.tobytes()
    assert decode_scenario(encode_scenario(world.scenario)) == world.scenario.anew()
    assert read_scenario(scenario_text(world.scenario).encode(), "a file") == world.scenario.anew()


def test_another_path_compiles_nothing():
    """All paths, shaped or not, use the same machine code of the engine."""
    world = World(load_preset("paper"))
    world.advance(2)
    known = len(advance.signatures)
    for kind in paths():
        world.apply(ChangeScenario({"trajectory.kind": kind, "trajectory.shaper": "zv"}))
        world.advance(2)
    assert len(advance.signatures) == known
