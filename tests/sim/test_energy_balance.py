"""Energy: arms and beam gain what the motors and pulls put in, less what the beam's damping takes out."""

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam, payload_row
from flexlab.sim.commands import Pull, Tap
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

INTEGRATORS = ["rk4", "etdrk4", "generalized-alpha"]
DURATIONS = {"rk4": 1.0, "etdrk4": 1.0, "generalized-alpha": 0.3}
"""Durations of controlled runs, s: generalized-alpha takes far more time, and its share of error is largest at the start."""


def imbalance(samples: Samples) -> float:
    """Largest |ΔE - ∫(power in - dissipation)|, J."""
    gained = samples.total_energy - samples.total_energy[0]
    put_in = samples.input_work - samples.input_work[0]
    lost = samples.dissipated_energy - samples.dissipated_energy[0]
    return float(np.abs(gained - put_in + lost).max())


def moved(samples: Samples) -> float:
    """Energy moved in or out through motors, pulls and damping, J."""
    return float(np.abs(np.diff(samples.input_work)).sum() + np.ptp(samples.dissipated_energy))


def bent(scenario: Scenario, force: float, at: float = 0.0) -> np.ndarray:
    """q at rest under a lateral force, N, at s = `at`, m."""
    matrices = build_beam(scenario.payload).matrices
    return np.linalg.solve(matrices.K_F, force * payload_row(scenario.payload, at))


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("preset", ["paper", "gravity", "single-arm", "soft-beam", "stiff-beam", "large-swing"])
def test_energy_is_balanced_with_control(preset: str, integrator: str):
    """The error is under 1e-6 of the energy moved in a second or less, at the automatic step."""
    run = simulate(load_preset(preset).replace({"simulation.integrator": integrator}), DURATIONS[integrator])
    assert run.status == "finished"
    assert imbalance(run) < 1e-6 * moved(run)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_energy_is_balanced_when_the_arms_fall(integrator: str):
    """With motors off and gravity on, the error is under 1e-6 of the gravity energy that turns into motion."""
    changes = {"controller.kind": "none", "gravity": 9.81, "initial.pose": (0.03, 0.9, 0.05)}
    run = simulate(load_preset("paper").replace({**changes, "simulation.integrator": integrator}), 0.2)
    assert run.status == "finished"
    assert np.ptp(run.gravity_energy) > 30
    assert imbalance(run) < 1e-6 * np.ptp(run.gravity_energy)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_energy_is_balanced_when_a_bent_beam_is_let_go_without_control(integrator: str):
    """A beam released from its static shape under a mid-span force rings and loses energy to its damping."""
    paper = load_preset("paper")
    changes = {"controller.kind": "none", "initial.beam_coordinates": bent(paper, 30.0)}
    run = simulate(paper.replace({**changes, "simulation.integrator": integrator}), 2.0)
    assert run.dissipated_energy[-1] > 0.4 * run.total_energy[0]
    assert imbalance(run) < 1e-6 * run.total_energy[0]


@pytest.mark.parametrize("integrator", ["rk4", "etdrk4"])
def test_energy_is_conserved_for_ten_seconds_without_control_and_damping(integrator: str):
    """The relative drift is at most 1e-6 at the default step, with arms moving slowly and the beam ringing."""
    paper = load_preset("paper")
    changes = {
        "controller.kind": "none",
        "payload.damping.coefficient": 0.0,
        "initial.pose_rate": (0.02, 0.02, -0.03),
        "initial.beam_coordinates": bent(paper, 30.0),
        "simulation.integrator": integrator,
    }
    run = simulate(paper.replace(changes), 10.0)
    assert run.status == "finished"
    assert run.elastic_energy.max() > 0.4 * run.total_energy[0]
    assert np.abs(run.total_energy / run.total_energy[0] - 1).max() <= 1e-6


@pytest.mark.parametrize("integrator", ["rk4", "etdrk4"])
def test_nothing_is_missing_from_the_balance(integrator: str):
    """With steps that resolve every mode (5 or 20 µs), gravity, control, damping, a pull and a tap balance to 1e-9."""
    changes = {
        "gravity": 9.81,
        "controller.kind": "pd",
        "payload.damping.coefficient": 0.3,
        "initial.beam_coordinates": (0.05, 0.006, -0.02, -0.03),
        "simulation.integrator": integrator,
        "simulation.step": 2e-5 if integrator == "etdrk4" else 5e-6,
    }
    world = World(load_preset("paper").replace(changes))
    world.apply(Tap(0.12, (0.3, -0.2)))
    world.apply(Pull(-0.1, (0.1, 0.9), 2000.0))
    samples = world.run(200)
    assert imbalance(samples) < 1e-9 * moved(samples)


def test_the_pulls_work_is_what_its_spring_gives():
    """Without motors, the input work is the energy that the spring has given up, ½k(d0² - d²)."""
    at, target, stiffness = 0.1, np.array([0.2, 0.9]), 500.0
    world = World(load_preset("paper").replace({"controller.kind": "none", "simulation.step": 5e-5}))
    world.apply(Pull(at, tuple(target), stiffness))
    samples = world.run(500)
    row = payload_row(world.scenario.payload, at)
    c, s, w = np.cos(samples.pose[:, 2]), np.sin(samples.pose[:, 2]), samples.beam_coordinates @ row
    point = samples.pose[:, :2] + np.stack([at * c - w * s, at * s + w * c], axis=1)
    spring = stiffness / 2 * np.sum((target - point) ** 2, axis=1)
    np.testing.assert_allclose(samples.input_work, spring[0] - spring, rtol=0, atol=1e-9 * spring[0])
