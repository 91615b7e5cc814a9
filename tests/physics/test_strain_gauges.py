"""What gauges on the beam's surface tell about its load moments hᵀq and gᵀq."""

import numpy as np
import pytest

from flexlab.physics.beam import beam_matrices, undamped_modes
from flexlab.physics.sensors import gauge_places, load_moments, strain_rows

LENGTH, RHO, EI, THICKNESS = 0.5, 2.0, 100.0, 0.004
BOUNDARIES = ["pinned-pinned", "clamped-clamped", "clamped-pinned", "pinned-clamped", "clamped-free"]


def moments_and_rows(n: int, boundary: str):
    beam = beam_matrices(LENGTH, RHO, EI, n, boundary)
    places, weights = gauge_places(LENGTH)
    rows = strain_rows(places, LENGTH, THICKNESS, n, boundary)
    return beam, load_moments(beam, EI, THICKNESS, weights, rows), rows


def test_a_reading_is_the_strain_at_the_surface():
    """For a half sine of amplitude a on 32 elements: ε = ½ t a (π/L)² cos(πs/L)."""
    n, amplitude = 32, 1e-3
    nodes = np.linspace(-LENGTH / 2, LENGTH / 2, n + 1)
    wave = np.pi / LENGTH
    q = np.stack([amplitude * np.cos(wave * nodes), -amplitude * wave * np.sin(wave * nodes)], axis=1).ravel()
    places, _ = gauge_places(LENGTH)
    _, _, rows = moments_and_rows(n, "pinned-pinned")
    exact = THICKNESS / 2 * amplitude * wave**2 * np.cos(wave * places)
    np.testing.assert_allclose(rows @ np.delete(q, [0, 2 * n]), exact, rtol=2e-3)


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_readings_tell_the_load_moments_exactly_on_two_elements(boundary: str):
    beam, moments, rows = moments_and_rows(2, boundary)
    q = np.random.default_rng(3).normal(size=len(beam.h))
    np.testing.assert_allclose(moments @ (rows @ q), [beam.h @ q, beam.g @ q], rtol=1e-12, atol=1e-12 * abs(beam.h @ q))


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_readings_tell_the_load_moment_of_the_first_mode_to_3_percent_on_a_fine_mesh(boundary: str):
    beam, moments, rows = moments_and_rows(16, boundary)
    first = undamped_modes(beam)[1][:, 0]
    assert moments[0] @ (rows @ first) == pytest.approx(beam.h @ first, rel=0.03)
