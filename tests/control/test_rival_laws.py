"""What computed torque, PD and vibration damping promise."""

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate


def peak(run: Run, signal: np.ndarray, start: float, stop: float) -> np.ndarray:
    return np.abs(signal[(run.time >= start) & (run.time <= stop)]).max(axis=0)


def test_computed_torque_gives_the_error_the_prescribed_dynamics():
    """ë + K_d ė + K_p e = 0: critically damped, e = e0 (1 + λt) e^{-λt}, with a payload too light to disturb it."""
    start = np.array([0.03, -0.02, 0.1])
    rates = np.array([20.0, 30.0, 15.0])
    changes = {
        "controller.kind": "computed-torque",
        "controller.position_gain": rates**2,
        "controller.velocity_gain": 2 * rates,
        "payload.linear_density": 1e-3,
        "initial.pose": np.array([0, 0.75, 0]) + start,
        "gravity": 9.81,
    }
    run = simulate(load_preset("paper").replace(changes), 0.5)
    # The desired motion starts at its full rate, the arms at rest.
    rate0 = -0.4 * np.pi * np.ones(3)
    t = run.time[:, None]
    expected = (start + (rate0 + rates * start) * t) * np.exp(-rates * t)
    np.testing.assert_allclose(run.tracking_error, expected, rtol=0, atol=1e-4 * np.abs(expected).max())


def test_under_pd_the_energy_of_error_and_motion_only_falls():
    """Without gravity and with the target at rest, T + U + ½eᵀPe never grows, and the error goes to zero."""
    gains = np.array([20000.0, 15000.0, 3000.0])
    changes = {
        "controller.kind": "pd",
        "controller.position_gain": gains,
        "trajectory.amplitude": (0.0, 0.0, 0.0),
        "initial.pose": (0.1, 0.8, 0.2),
        "initial.beam_coordinates": (0.05, 0.006, -0.02, -0.03),
    }
    run = simulate(load_preset("paper").replace(changes), 2.0)
    V = run.total_energy + (gains * run.tracking_error**2).sum(axis=1) / 2
    assert np.all(np.diff(V) <= 1e-9 * V[0])
    assert V[-1] < 1e-4 * V[0]
    assert np.abs(run.tracking_error[-1]).max() < 1e-3


def test_pd_carries_the_weight():
    """With gravity it settles on the target, not below it: Ḡ_i and the payload's weight are compensated."""
    changes = {"controller.kind": "pd", "trajectory.amplitude": (0.0, 0.0, 0.0), "gravity": 9.81}
    run = simulate(load_preset("paper").replace(changes), 3.0)
    assert np.abs(run.tracking_error[-1]).max() < 1e-6


@pytest.fixture(scope="module")
def pair() -> tuple[Run, Run]:
    """The paper's run, without and with vibration damping (k_v = 100)."""
    paper = load_preset("paper")
    damped = paper.replace({"controller.kind": "vibration-damping", "controller.lateral_vibration_gain": 100.0})
    return simulate(paper, 1.5), simulate(damped, 1.5)


def test_vibration_damping_ends_the_free_vibration_within_an_eighth_of_a_second(pair):
    """Under 1 % of its peak is left from 0.125 s on; without damping a fifth is left after 0.1 s, and 1 % after 0.44 s.

    With damping 1.3 % is left at 0.1 s, most of it forced by the motion, which is still catching up with its path.
    """
    paper, damped = pair
    for run, gone in ((paper, 0.44), (damped, 0.125)):
        assert peak(run, run.vibration, gone, 1.5) < 0.01 * peak(run, run.vibration, 0, 1.5)
    assert peak(paper, paper.vibration, 0.1, 1.5) > 0.2 * peak(paper, paper.vibration, 0, 1.5)


def test_vibration_damping_costs_little_tracking(pair):
    """Peak tracking errors change by under 2 %."""
    paper, damped = pair
    change = peak(damped, damped.tracking_error, 0, 1.5) / peak(paper, paper.tracking_error, 0, 1.5) - 1
    assert np.abs(change).max() < 0.02


def test_vibration_damping_raises_the_internal_force(pair):
    """One of its peaks after the start rises by more than 20 %."""
    paper, damped = pair
    rise = peak(damped, damped.internal_force, 0.001, 1.5) / peak(paper, paper.internal_force, 0.001, 1.5)
    assert rise.max() > 1.2


def test_vibration_damping_with_zero_gains_is_the_papers_law():
    """k_v = k_θ = 0: the same run to rounding."""
    changes = {
        "controller.kind": "vibration-damping",
        "controller.lateral_vibration_gain": 0.0,
        "controller.angular_vibration_gain": 0.0,
    }
    paper = load_preset("paper")
    plain, zero = simulate(paper, 0.2), simulate(paper.replace(changes), 0.2)
    np.testing.assert_allclose(zero.pose, plain.pose, rtol=0, atol=1e-15)
    np.testing.assert_allclose(zero.beam_coordinates, plain.beam_coordinates, rtol=0, atol=1e-15)


@pytest.mark.parametrize(("gain", "field"), [(300.0, "lateral"), (3000.0, "angular")])
def test_the_largest_vibration_gains_of_the_sliders_keep_running(gain: float, field: str):
    """The sliders' upper ends, at the automatic step."""
    changes = {"controller.kind": "vibration-damping", f"controller.{field}_vibration_gain": gain}
    run = simulate(load_preset("paper").replace(changes), 0.3)
    assert run.status == "finished", run.status.text
