"""Finite-element integrals and static bending against closed forms."""

import numpy as np
import pytest

from flexlab.physics.beam import beam_matrices, shape_row
from flexlab.scenario.payload import FIXED_COORDINATES, Payload
from flexlab.sim.build import build_beam

LENGTH, RHO, EI = 0.6, 1.7, 42.0

STATIC = {
    "pinned-pinned": lambda z: z * (1 - 2 * z**2 + z**3) / 24,
    "clamped-clamped": lambda z: z**2 * (1 - z) ** 2 / 24,
    "clamped-free": lambda z: z**2 * (6 - 4 * z + z**2) / 24,
    "clamped-pinned": lambda z: z**2 * (3 - 5 * z + 2 * z**2) / 48,
    "pinned-clamped": lambda z: (1 - z) ** 2 * (3 - 5 * (1 - z) + 2 * (1 - z) ** 2) / 48,
}
"""Boundary → w EI/(p L⁴) of a beam under the uniform load p, at z = s/L + ½."""


@pytest.mark.parametrize("n", [2, 5, 16])
@pytest.mark.parametrize("boundary", STATIC)
def test_uniform_load_bends_the_nodes_exactly(n: int, boundary: str):
    """K_F q = ∫N p ds: the deflections at the nodes of cubic elements are exact."""
    beam = beam_matrices(LENGTH, RHO, EI, n, boundary)
    load = 3.0
    q = np.linalg.solve(beam.K_F, load / RHO * beam.h)
    for z in np.linspace(0, 1, n + 1):
        found = shape_row((z - 0.5) * LENGTH, LENGTH, n, boundary) @ q
        assert found == pytest.approx(STATIC[boundary](z) * load * LENGTH**4 / EI, rel=1e-9, abs=1e-15)


def test_midspan_load_bends_a_pinned_beam_by_pl3_over_48ei():
    """w(0) = P L³/(48 EI)."""
    beam = beam_matrices(LENGTH, RHO, EI, 4, "pinned-pinned")
    middle = shape_row(0.0, LENGTH, 4, "pinned-pinned")
    assert middle @ np.linalg.solve(beam.K_F, 5.0 * middle) == pytest.approx(5.0 * LENGTH**3 / (48 * EI), rel=1e-12)


@pytest.mark.parametrize("boundary", STATIC)
def test_integrals_match_gauss_quadrature(boundary: str):
    """M_q = ρ∫NᵀN ds, h = ρ∫Nᵀds, g = ρ∫sNᵀds, m = ρL, I = ρL³/12."""
    n = 3
    beam = beam_matrices(LENGTH, RHO, EI, n, boundary)
    M, h, g = np.zeros_like(beam.M_q), np.zeros_like(beam.h), np.zeros_like(beam.g)
    points, weights = np.polynomial.legendre.leggauss(12)
    for element in range(n):
        low = element * LENGTH / n - LENGTH / 2
        for point, weight in zip(points, weights, strict=True):
            s, dm = low + (point + 1) / 2 * LENGTH / n, RHO * weight * LENGTH / n / 2
            N = shape_row(s, LENGTH, n, boundary)
            M, h, g = M + dm * np.outer(N, N), h + dm * N, g + dm * s * N
    np.testing.assert_allclose(beam.M_q, M, rtol=1e-12, atol=1e-16)
    np.testing.assert_allclose(beam.h, h, rtol=1e-12, atol=1e-16)
    np.testing.assert_allclose(beam.g, g, rtol=1e-12, atol=1e-16)
    assert (beam.m, beam.I) == pytest.approx((RHO * LENGTH, RHO * LENGTH**3 / 12), rel=1e-14)


@pytest.mark.parametrize("boundary", FIXED_COORDINATES)
def test_held_coordinates_are_left_out_of_the_vector(boundary: str):
    """n_q = 2 (n + 1) less the number of held coordinates, for every mesh."""
    for n in (2, 3, 64):
        payload = Payload(element_count=n, boundary=boundary)
        assert build_beam(payload).matrices.M_q.shape == (payload.coordinate_count,) * 2
        assert payload.coordinate_count == 2 * (n + 1) - FIXED_COORDINATES[boundary]


def test_two_pinned_elements_have_the_papers_coordinates():
    """q = [left slope, mid deflection, mid slope, right slope]: N and N' at the nodes pick each one out."""
    at, step = LENGTH / 2, 1e-7
    left, middle, right = (shape_row(s, LENGTH, 2, "pinned-pinned") for s in (-at + step, 0.0, at - step))
    beyond = shape_row(step, LENGTH, 2, "pinned-pinned")
    np.testing.assert_allclose(left / step, [1, 0, 0, 0], atol=1e-5)
    np.testing.assert_allclose(middle, [0, 1, 0, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose((beyond - middle) / step, [0, 0, 1, 0], atol=1e-5)
    np.testing.assert_allclose(-right / step, [0, 0, 0, 1], atol=1e-5)
