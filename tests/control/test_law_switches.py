"""A change of law in motion: the torques jump only by the difference of the two laws, and replays repeat the change."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from reference.control_laws import LAWS, start
from reference.flexible_system import FlexibleSystem
from reference.terms import random_scenario

from flexlab.analysis.replay import replay
from flexlab.control.law import laws
from flexlab.presets import load_preset
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.store.run_files import list_runs
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

WITH_BOUNDS = {
    "adaptive-sliding-mode",
    "vibration-damping",
    "sliding-mode",
    "computed-torque",
    "pd",
    "joint-pd",
    "none",
}
"""Laws that keep b̂ when they take over, and pass it on."""


def scenario_of(kind: str) -> Scenario:
    """Two different arms in gravity with unequal shares and a wrong belief."""
    changes = {
        "controller.kind": kind,
        "controller.load_share": 0.3,
        "controller.model.linear_density_factor": 1.3,
        "payload.bending_stiffness": 20.0,
        "trajectory.amplitude": (0.1, 0.1, 0.1),
    }
    return random_scenario(3).replace(changes)


def torques(scenario: Scenario, at: Samples, b_hat: np.ndarray, fresh: bool) -> np.ndarray:
    """Joint torques (arms, 3) by the law's equation in the state of a sample."""
    kind, own = scenario.controller.kind, at.own
    system = FlexibleSystem(scenario, LAWS[kind], start)
    state = np.concatenate([at.pose[0], at.pose_rate[0], at.beam_coordinates[0], at.beam_rates[0]])
    seen = system.see(float(at.time[0]), state)
    memory = b_hat if kind in WITH_BOUNDS else start(seen)
    if not fresh and kind == "regressor-adaptive":
        named = ("payload_mass_estimate", "payload_inertia_estimate", "link_mass_estimates")
        memory = np.concatenate([own[name][0].ravel() for name in named])
    elif not fresh and kind == "super-twisting":
        memory = own["twisting_force"][0]
    elif not fresh and kind == "disturbance-observer":
        memory = np.concatenate(
            [start(seen)[:3] - own["disturbance_estimate"][0] / scenario.controller.observer_gain, np.zeros(3)]
        )
    u, _ = system.inputs(seen, memory)
    return np.array([np.linalg.solve(arm.R.T, each) for arm, each in zip(seen.arms, u, strict=True)])


@pytest.mark.parametrize("first", LAWS)
def test_the_jump_is_the_difference_of_the_laws(first: str):
    for second in LAWS:
        if second == first:
            continue
        world = World(scenario_of(first))
        world.advance(30)
        before = world.observe()
        world.apply(ChangeScenario({"controller.kind": second}))
        after = world.observe()
        b_hat = before.bound_estimates[0] if first in WITH_BOUNDS else np.zeros(3)
        own = torques(scenario_of(second), before, b_hat, True) - torques(scenario_of(first), before, b_hat, False)
        jump = after.joint_torque[0] - before.joint_torque[0]
        np.testing.assert_allclose(jump, own, rtol=0, atol=1e-8 * max(1.0, np.abs(own).max()), err_msg=second)
        assert len(world.advance(20)) == 20, world.status.text


def test_a_sampled_observer_that_takes_over_between_instants_starts_at_zero():
    """p(0) is taken at its first instant: the momentum gained in the 2 ms before it is no disturbance."""
    world = World(load_preset("smooth-start").replace({"controller.control_period": 0.005}))
    world.advance(243)
    unprepared = 20.0 * 0.002 * np.abs(world.observe().arm_input[0].sum(axis=0)).max()
    world.apply(ChangeScenario({"controller.kind": "disturbance-observer"}))
    observed = np.abs(world.advance(2)["disturbance_estimate"][-1]).max()
    assert 0 < observed < 0.1 * unprepared


@pytest.mark.parametrize("period", [None, 0.002])
@pytest.mark.parametrize(
    "change", [{"controller.observer_gain": 35.0}, {"controller.model.linear_density_factor": 2.0}, {"gravity": 9.0}]
)
def test_the_observed_disturbance_does_not_jump_with_gain_or_belief(period: float | None, change: dict):
    paper = load_preset("paper").replace(
        {"controller.kind": "disturbance-observer", "controller.control_period": period}
    )
    world = World(paper)
    world.advance(50)
    before = world.observe()["disturbance_estimate"][0]
    world.apply(ChangeScenario(change))
    world.advance(0)
    if period is None:
        np.testing.assert_allclose(world.observe()["disturbance_estimate"][0], before, rtol=0, atol=1e-9)
    after = world.advance(2)["disturbance_estimate"][-1]
    unprepared = np.abs(before).max() + 1.0
    assert np.abs(after - before).max() < unprepared


@pytest.mark.parametrize("period", [None, 0.002])
def test_a_live_run_through_all_laws_is_replayed_bit_for_bit(period: float | None, tmp_path: Path):
    """A law with other signals starts another recording, in which time and motion continue."""
    kinds, now = [kind for kind in LAWS if kind != "none"], [0.0]
    scenario = load_preset("gravity").replace({"controller.kind": kinds[0], "controller.control_period": period})
    recorder = Recorder(tmp_path)
    runner = Runner(scenario, "all laws", [recorder], clock=lambda: now[0])
    for kind in [*kinds[1:], None]:
        for _ in range(2):
            now[0] += 0.0173
            runner.frame()
        if kind is not None:
            runner.submit(ChangeScenario({"controller.kind": kind}))
    assert runner.snapshot.scenario.controller.kind == kinds[-1]
    runner.stop()
    recorder.close()
    recordings = sorted((read_recording(path) for path in list_runs(tmp_path)), key=lambda each: each.samples.time[0])
    assert len(recordings) == 1 + sum(laws()[one].signals != laws()[other].signals for one, other in pairwise(kinds))
    for earlier, later in pairwise(recordings):
        assert later.samples.time[0] == earlier.samples.time[-1]
        np.testing.assert_allclose(later.samples.pose[0], earlier.samples.pose[-1], rtol=0, atol=1e-15)
    for recording in recordings:
        assert replay(recording).identical


def test_a_headless_run_has_the_signals_of_each_law_while_it_acts():
    kinds = ("pd", "super-twisting", "disturbance-observer", "pd")
    commands = [(0.02 * k, ChangeScenario({"controller.kind": kind})) for k, kind in enumerate(kinds) if k > 0]
    run = simulate(load_preset("paper").replace({"controller.kind": kinds[0]}), 0.08, commands=commands)
    plain = simulate(load_preset("paper").replace({"controller.kind": "pd"}), 0.02)
    assert len(run) == 81
    np.testing.assert_array_equal(run.time, np.arange(81) * 0.001)
    assert run.pose[:21].tobytes() == plain.pose.tobytes()
    at_work = np.isfinite(run["twisting_force"][:, 0])
    np.testing.assert_array_equal(np.flatnonzero(at_work), np.arange(21, 41))
    assert np.isfinite(run["disturbance_estimate"][41:61]).all()
