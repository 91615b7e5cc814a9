"""Seeded noise on what a sampled controller measures."""

import numba
import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.sampled_control import Sampling, gaussian, measure_beam
from flexlab.sim.simulate import simulate
from flexlab.sim.step_trial import build_assembly

COUNT = 20_000


@numba.njit
def draw(seed: int, channels: int) -> np.ndarray:
    """Random numbers of one seed, (channels, COUNT)."""
    numbers = np.empty((channels, COUNT))
    for channel in range(channels):
        for instant in range(COUNT):
            numbers[channel, instant] = gaussian(seed, instant, channel)
    return numbers


@pytest.fixture(scope="module")
def numbers() -> np.ndarray:
    """Random numbers of one seed, (channels, instants)."""
    return draw(7, 8)


def test_numbers_are_standard_normal(numbers: np.ndarray):
    """Mean 0, variance 1, skewness 0, kurtosis 3, each within five standard errors, and the right tails."""
    for values in numbers:
        assert abs(values.mean()) < 5 / np.sqrt(COUNT)
        assert abs(values.var() - 1) < 5 * np.sqrt(2 / COUNT)
        assert abs((values**3).mean()) < 5 * np.sqrt(15 / COUNT)
        assert abs((values**4).mean() - 3) < 5 * np.sqrt(96 / COUNT)
        within = np.array([(np.abs(values) < k).mean() for k in (1, 2, 3)])
        np.testing.assert_allclose(within, [0.6827, 0.9545, 0.9973], rtol=0, atol=0.017)


def test_channels_instants_and_seeds_are_independent(numbers: np.ndarray):
    """There is no correlation between channels, neighbouring instants or seeds (five standard errors)."""
    limit = 5 / np.sqrt(COUNT)
    correlation = np.corrcoef(numbers) - np.eye(8)
    assert np.abs(correlation).max() < limit
    for lag in (1, 2, 5):
        assert abs((numbers[:, lag:] * numbers[:, :-lag]).mean(axis=1)).max() < limit
    other = draw(8, 1)[0]
    assert abs((other * numbers[0]).mean()) < limit
    assert abs((other[1:] * numbers[0, :-1]).mean()) < limit


def noisy(seed: int = 1, **changes) -> Scenario:
    """The paper's law at 1 kHz with noisy sensors."""
    noise = {"pose": [1e-5] * 3, "pose_rate": [1e-3] * 3, "strain": 1e-6, "seed": seed}
    base = {"controller.control_period": 0.001, "controller.sensor_noise": noise}
    return load_preset("smooth-start").replace(base | changes)


def test_the_same_seed_gives_the_same_bits(same_bits):
    same_bits(simulate(noisy(), 0.2), simulate(noisy(), 0.2))


def test_another_seed_gives_another_run():
    """No noise gives a third one."""
    quiet = simulate(noisy().replace({"controller.sensor_noise": {}}), 0.2)
    first, second = simulate(noisy(1), 0.2), simulate(noisy(2), 0.2)
    assert np.abs(first.joint_torque - second.joint_torque).max() > 0.1
    assert np.abs(first.joint_torque - quiet.joint_torque).max() > 0.1


def measured_error(run, gain: np.ndarray) -> np.ndarray:
    """Error of what a PD law without rate gain has measured, from its inputs u = -P (e + noise)."""
    return -run.arm_input.sum(axis=1) / gain - run.tracking_error


@pytest.mark.parametrize("sigma", [(1e-6, 2e-6, 4e-6), (3e-6, 0.0, 0.0)])
def test_noise_on_the_pose_has_the_size_asked_for(sigma: tuple[float, ...]):
    """The inputs show what the controller measured: e plus noise of the given standard deviation, per component."""
    gain = np.array([2000.0, 2000.0, 500.0])
    changes = {
        "controller.kind": "pd",
        "controller.position_gain": gain,
        "controller.velocity_gain": 0.0,
        "trajectory.amplitude": (0.0, 0.0, 0.0),
        "controller.sensor_noise": {"pose": sigma},
    }
    run = simulate(noisy(**changes), 2.0)
    seen = measured_error(run, gain)
    for component in range(3):
        if sigma[component] == 0:
            assert np.abs(seen[:, component]).max() < 0.05 * max(sigma)
        else:
            assert seen[:, component].std() == pytest.approx(sigma[component], rel=0.1)
            assert abs(seen[:, component].mean()) < 5 * sigma[component] / np.sqrt(len(seen))


def test_noise_on_the_rate_has_the_size_asked_for():
    """As for the pose, seen through the rate gain."""
    gain, sigma = np.array([400.0, 400.0, 100.0]), np.array([1e-4, 2e-4, 3e-4])
    changes = {
        "controller.kind": "pd",
        "controller.position_gain": 0.0,
        "controller.velocity_gain": gain,
        "trajectory.amplitude": (0.0, 0.0, 0.0),
        "controller.sensor_noise": {"pose_rate": sigma},
    }
    run = simulate(noisy(**changes), 2.0)
    seen = -run.arm_input.sum(axis=1) / gain - run.pose_rate
    np.testing.assert_allclose(seen.std(axis=0), sigma, rtol=0.1)


def test_strain_noise_matters_to_vibration_damping_only(same_bits):
    """Only that law measures the beam."""
    strain = {"controller.sensor_noise": {"strain": 1e-5}}
    quiet = {"controller.sensor_noise": {}}
    same_bits(simulate(noisy(**strain), 0.1), simulate(noisy(**quiet), 0.1))
    kind = {"controller.kind": "vibration-damping"}
    difference = (
        simulate(noisy(**kind, **strain), 0.1).joint_torque - simulate(noisy(**kind, **quiet), 0.1).joint_torque
    )
    assert np.abs(difference).max() > 0.1


def test_samples_show_the_state_without_noise():
    """They are not measurements: pose and rate belong together."""
    run = simulate(noisy(), 0.2)
    moved = np.diff(run.pose, axis=0)
    mean_rate = (run.pose_rate[1:] + run.pose_rate[:-1]) / 2
    np.testing.assert_allclose(moved, 0.001 * mean_rate, rtol=0, atol=1e-6)


@numba.njit
def measure(sampling: Sampling, seen: np.ndarray) -> None:
    """Fill `seen`, (count, 2), with readings of a beam at rest."""
    still = np.zeros(2)
    for instant in range(len(seen)):
        measure_beam(sampling, instant, still, seen[instant])


def beam_readings(scenario: Scenario, count: int = 5000) -> np.ndarray:
    """Measured hᵀq̇ and gᵀq̇ of a beam at rest, (count, 2)."""
    seen = np.zeros((count, 2))
    measure(build_assembly(scenario, 0.001).sampling, seen)
    return seen


def test_strain_noise_is_that_of_differenced_readings():
    """σ of hᵀq̇ is √2 σ_ε ‖W‖/T_c, kg·m/s, with W by hand for the paper's pinned beam; each reading enters two differences."""
    sigma, period, t = 2e-6, 0.002, 0.004
    changes = {
        "controller.kind": "vibration-damping",
        "controller.control_period": period,
        "controller.sensor_noise": {"strain": sigma},
        "payload.thickness": t,
    }
    seen = beam_readings(load_preset("paper").replace(changes))
    # For a pinned beam hᵀq = ∫ ½ρ(s² - L²/4) w'' ds, with the bending moment of a uniform load; gᵀq has ρ(s³/6 - sL²/24).
    s = np.array([-1, -1, 1, 1]) * 0.125 + np.array([-1, 1, -1, 1]) * 0.125 / np.sqrt(3)
    moments = np.array([0.5 * 2 * (s**2 - 0.0625), 2 * (s**3 / 6 - s * 0.25 / 24)])
    expected = np.sqrt(2) * sigma / period * np.linalg.norm(2 / t * 0.125 * moments, axis=1)
    # Two elements give the bending moment of a load except for what a piecewise linear curve misses.
    np.testing.assert_allclose(seen.std(axis=0), expected, rtol=0.12)
    correlation = (seen[1:] * seen[:-1]).mean(axis=0) / seen.var(axis=0)
    np.testing.assert_allclose(correlation, -0.5, atol=0.05)
    assert np.abs(np.corrcoef(seen.T)[0, 1]) < 0.05


def test_strain_noise_depends_on_the_thickness_and_not_on_the_mesh():
    """Twice the thickness gives half the noise; eight elements give the same noise as thirty-two."""
    base = {
        "controller.kind": "vibration-damping",
        "controller.control_period": 0.001,
        "controller.sensor_noise": {"strain": 1e-6},
    }
    paper = load_preset("paper").replace(base)
    thin, thick = (beam_readings(paper.replace({"payload.thickness": t}), 10) for t in (0.002, 0.004))
    np.testing.assert_allclose(thin, 2 * thick, rtol=1e-9)
    coarse, fine = (beam_readings(paper.replace({"payload.element_count": n}), 10) for n in (8, 32))
    np.testing.assert_allclose(coarse, fine, rtol=0.05, atol=0.01 * np.abs(fine).max())


def test_noise_of_the_moment_rates_has_the_size_asked_for():
    noise = {"controller.control_period": 0.001, "controller.sensor_noise": {"moment_rate": (2e-3, 3e-4)}}
    seen = beam_readings(load_preset("paper").replace(noise))
    np.testing.assert_allclose(seen.std(axis=0), [2e-3, 3e-4], rtol=0.05)
