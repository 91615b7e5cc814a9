"""The paper's experiment against the independent solution and a table of figures that it must show."""

import numpy as np
import pytest
from reference.solutions import PAPER, SAMPLE_PERIOD

from flexlab.presets import load_preset
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate

TOLERANCE = {
    "pose": 1e-6,
    "beam_coordinates": 1e-6,
    "pose_rate": 1e-6,
    "tracking_error": 1e-6,
    "sliding_variable": 1e-6,
    "bound_estimates": 1e-6,
    "internal_force": 1e-3,
    "arm_input": 1e-2,
    "joint_torque": 1e-2,
    "pose_acceleration": 1e-4,
    "beam_rates": 1e-5,
}
"""Largest difference of each signal, in its unit (m, rad, m/s, N, N·m, …)."""


@pytest.fixture(scope="module")
def paper() -> Run:
    """A run of three seconds, as in the README."""
    return simulate(load_preset("paper"), duration=3.0, sample_period=SAMPLE_PERIOD)


def span(run: Run, start: float, stop: float) -> slice:
    """Rows in a span of time, ends included."""
    return slice(round(start / SAMPLE_PERIOD), round(stop / SAMPLE_PERIOD) + 1)


@pytest.mark.parametrize("signal", TOLERANCE)
def test_signals_agree_with_the_independent_solution_at_its_nine_instants(paper: Run, signal: str):
    """Pose and beam coordinates within 1e-6, internal force within 1e-3 N, torques within 1e-2 N·m."""
    assert len(PAPER.time) == 9
    assert paper.status == "finished"
    assert PAPER.difference(paper, signal) < TOLERANCE[signal]


@pytest.mark.parametrize("integrator", ["rk4", "etdrk4", "generalized-alpha"])
def test_every_integrator_reaches_the_same_solution_with_its_automatic_step(integrator: str):
    """Pose and beam coordinates within 1e-6 over the first half second, which holds the ring."""
    run = simulate(load_preset("paper").replace({"simulation.integrator": integrator}), 0.5, SAMPLE_PERIOD)
    within = PAPER.time <= 0.5
    for signal in ("pose", "beam_coordinates"):
        found, expected = getattr(run, signal)[PAPER.rows[within]], PAPER.signals[signal][within]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def test_early_tracking_error(paper: Run):
    """Max over 0..0.1 s: 1.674e-2 m, 1.704e-2 m, 7.005e-3 rad."""
    error = np.abs(paper.tracking_error[span(paper, 0, 0.1)]).max(axis=0)
    np.testing.assert_allclose(error, [1.674e-2, 1.704e-2, 7.005e-3], rtol=5e-4)


def test_late_tracking_error(paper: Run):
    """Max over 2..3 s: 1.409e-4 m, 7.094e-4 m, 4.090e-5 rad."""
    error = np.abs(paper.tracking_error[span(paper, 2, 3)]).max(axis=0)
    np.testing.assert_allclose(error, [1.409e-4, 7.094e-4, 4.090e-5], rtol=5e-4)


def test_mid_deflection(paper: Run):
    """Max over 0..0.1 s 1.770e-3 m, over 1..2 s 1.519e-4 m; it is the second beam coordinate."""
    deflection = np.abs(paper.midspan_deflection)
    assert deflection[span(paper, 0, 0.1)].max() == pytest.approx(1.770e-3, rel=5e-4)
    assert deflection[span(paper, 1, 2)].max() == pytest.approx(1.519e-4, rel=5e-4)
    np.testing.assert_allclose(paper.midspan_deflection, paper.beam_coordinates[:, 1], rtol=0, atol=1e-15)


def test_forces_and_torques_at_the_start(paper: Run):
    """Internal force of arm 1: [-48.368, 306.939] N, 50.920 N·m; its joint torques -638.890, 284.855, 200.605 N·m."""
    np.testing.assert_allclose(paper.internal_force[0, 0], [-48.368, 306.939, 50.920], atol=5e-4)
    np.testing.assert_allclose(paper.joint_torque[0, 0], [-638.890, 284.855, 200.605], atol=5e-4)


def test_bound_estimates_at_the_end(paper: Run):
    """b̂ = 0.02539, 0.02095, 0.06735 at t = 3 s."""
    np.testing.assert_allclose(paper.bound_estimates[-1], [0.02539, 0.02095, 0.06735], rtol=0, atol=5e-6)
