"""Frequencies of the finite-element beam against Euler-Bernoulli theory."""

import numpy as np
import pytest
from scipy.optimize import brentq

from flexlab.physics.beam import beam_matrices, undamped_modes
from flexlab.scenario import Payload
from flexlab.sim.build import build_beam

LENGTH, RHO, EI = 0.5, 2.0, 100.0
WAVE_SPEED = np.sqrt(EI / RHO) / LENGTH**2
"""√(EI/ρ)/L², 1/s: a frequency is this times the square of a root of the boundary's equation."""

EQUATIONS = {
    "pinned-pinned": np.sin,
    "clamped-clamped": lambda z: np.cos(z) - 1 / np.cosh(z),
    "clamped-free": lambda z: np.cos(z) + 1 / np.cosh(z),
    "clamped-pinned": lambda z: np.tan(z) - np.tanh(z),
    "pinned-clamped": lambda z: np.tan(z) - np.tanh(z),
}


def roots(boundary: str, count: int) -> np.ndarray:
    """The lowest wave numbers times length, from the boundary's characteristic equation."""
    equation = EQUATIONS[boundary]
    grid = np.arange(0.5, 40, 0.01)
    values = equation(grid)
    crossings = np.flatnonzero((np.sign(values[1:]) != np.sign(values[:-1])) & (np.abs(np.diff(values)) < 1))
    return np.array([brentq(equation, grid[k], grid[k + 1], xtol=1e-14) for k in crossings[:count]])


def frequencies(n: int, boundary: str = "pinned-pinned") -> np.ndarray:
    """All frequencies of a mesh in ascending order, rad/s."""
    return undamped_modes(beam_matrices(LENGTH, RHO, EI, n, boundary))[0]


def test_two_elements_give_the_papers_four_frequencies():
    """n = 2, pinned-pinned, at the paper's values."""
    np.testing.assert_allclose(frequencies(2), [280.256, 1239.35, 3115.22, 5679.44], rtol=4e-6)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_pinned_eigenvalues_converge_from_above_with_order_four(mode: int):
    """Rayleigh-Ritz: ω² ≥ (kπ/L)⁴ EI/ρ, and with cubic elements the difference falls as n⁻⁴ (slope 3.9 to 4.1).

    Mode 1 has 2, 4, 8 and 16 elements; mode k has k times as many, so that each half wave has the same number.
    """
    exact = (mode * np.pi / LENGTH) ** 4 * EI / RHO
    errors = np.array([frequencies(n * mode)[mode - 1] ** 2 - exact for n in (2, 4, 8, 16)])
    assert np.all(errors > 0)
    slopes = np.log2(errors[:-1] / errors[1:])
    assert np.all((slopes > 3.9) & (slopes < 4.1)), slopes


@pytest.mark.parametrize(
    ("boundary", "hertz"),
    [("clamped-clamped", [100.72, 277.63, 544.26]), ("clamped-free", [15.83, 99.19])],
)
def test_clamped_frequencies_at_the_papers_values(boundary: str, hertz: list[float]):
    np.testing.assert_allclose(frequencies(32, boundary)[: len(hertz)] / (2 * np.pi), hertz, atol=0.005)


@pytest.mark.parametrize("boundary", EQUATIONS)
def test_every_boundary_meets_its_characteristic_equation(boundary: str):
    """ω = √(EI/ρ) z²/L² with the roots z of the boundary's equation; the mesh raises it by the share (z/n)⁴/1440."""
    z, n = roots(boundary, 4), 24
    excess = frequencies(n, boundary)[:4] / (WAVE_SPEED * z**2) - 1
    np.testing.assert_allclose(excess, (z / n) ** 4 / 1440, rtol=0.05)


@pytest.mark.parametrize("boundary", EQUATIONS)
def test_the_finest_mesh_keeps_the_lowest_frequency_to_rounding(boundary: str):
    """At n = 64, the large condition number of the mesh (10⁸) does not affect the lowest modes."""
    exact = WAVE_SPEED * roots(boundary, 1) ** 2
    np.testing.assert_allclose(frequencies(64, boundary)[:1], exact, rtol=3e-8)


@pytest.mark.parametrize("n", [1, 2, 7, 64])
@pytest.mark.parametrize("boundary", EQUATIONS)
def test_shapes_are_mass_normalised_and_diagonalise_the_stiffness(n: int, boundary: str):
    """VᵀM_qV = 1 and VᵀK_FV = Ω²."""
    if (n, boundary) == (1, "clamped-clamped"):
        n = 3  # one element has no coordinate left
    beam = beam_matrices(LENGTH, RHO, EI, n, boundary)
    omega, V = undamped_modes(beam)
    assert np.all(np.diff(omega) > 0)
    np.testing.assert_allclose(V.T @ beam.M_q @ V, np.eye(len(omega)), rtol=0, atol=1e-11)
    scaled = V.T @ beam.K_F @ V / np.outer(omega, omega)
    np.testing.assert_allclose(np.diag(scaled), 1, rtol=0, atol=1e-9)
    np.testing.assert_allclose(scaled, np.eye(len(omega)), rtol=0, atol=1e-6)


@pytest.mark.parametrize("n", [1, 2, 16, 64])
def test_a_scenarios_first_frequency_scales_with_stiffness_density_and_length(n: int):
    """ω ∝ √(EI/ρ)/L²."""
    plain = build_beam(Payload(element_count=n)).modes.omega.min()
    other = build_beam(Payload(element_count=n, bending_stiffness=36.0, linear_density=0.5, length=0.7)).modes.omega
    assert other.min() == pytest.approx(plain * np.sqrt(0.36 / 0.25) * (0.5 / 0.7) ** 2, rel=1e-10)
