"""The force along the beam: matrices against closed forms and quadrature, and the effect of squeezing and spinning a beam."""

import numpy as np
import pytest

from flexlab.analysis.validation.beam import SPUN, critical_load, spun_frequency, squeezed_frequency
from flexlab.physics.axial_load import (
    BUCKLING,
    buckling_load,
    geometric_matrices,
    geometric_stiffness,
    part_beyond,
)
from flexlab.physics.beam import shape_row
from flexlab.scenario import Payload
from flexlab.sim.build import build_beam

L, RHO, EI = 0.5, 2.0, 100.0


def test_the_matrix_of_one_element_is_that_of_the_textbook() -> None:
    """Przemieniecki, Theory of Matrix Structural Analysis, Eq. 15.25."""
    expected = np.array([[36, 3 * L, -36, 3 * L], [3 * L, 4 * L**2, -3 * L, -(L**2)],
                         [-36, -3 * L, 36, -3 * L], [3 * L, -(L**2), -3 * L, 4 * L**2]]) / (30 * L)  # fmt: skip
    # Pinned ends leave only the slopes.
    found = geometric_stiffness(L, 1, "pinned-pinned", lambda _: 1.0)
    np.testing.assert_allclose(found, expected[np.ix_([1, 3], [1, 3])], rtol=1e-14)


@pytest.mark.parametrize("boundary", BUCKLING)
def test_matrices_are_the_integrals_over_their_forces(boundary: str) -> None:
    """Compared with a fine sum, whose slopes are differences of the shape functions."""
    n, count = 3, 60_000
    s = (np.arange(count) + 0.5) * L / count - L / 2
    step = 1e-6
    slopes = np.array([
        (shape_row(at + step, L, n, boundary) - shape_row(at - step, L, n, boundary)) / (2 * step) for at in s[:: 20]
    ])  # fmt: skip
    places, weight = s[::20], L / len(s[::20])
    G0, G1, G2 = geometric_matrices(L, RHO, n, boundary)
    for found, force in (
        (G0, np.ones_like(places)),
        (G1, RHO * (places + L / 2)),
        (G2, RHO / 2 * (L**2 / 4 - places**2)),
    ):
        exact = (slopes.T * force * weight) @ slopes
        np.testing.assert_allclose(found, exact, atol=2e-3 * np.abs(exact).max())


def test_the_parts_before_and_beyond_a_hand_make_up_the_whole() -> None:
    """The hand is at either end, or within an element."""
    whole = geometric_stiffness(L, 4, "clamped-pinned", lambda _: 1.0)
    np.testing.assert_array_equal(part_beyond(L, 4, "clamped-pinned", -L / 2), whole)
    assert not part_beyond(L, 4, "clamped-pinned", L / 2).any()
    # In the mirrored beam, the part before the hand is the part beyond it.
    before = whole - part_beyond(L, 4, "clamped-pinned", -0.07)
    mirrored = part_beyond(L, 4, "pinned-clamped", 0.07)
    eigen = np.linalg.eigvalsh(before), np.linalg.eigvalsh(mirrored)
    np.testing.assert_allclose(*eigen, rtol=0, atol=1e-12 * np.abs(eigen[0]).max())


def test_modal_matrices_are_symmetric_and_agree_with_the_nodal_ones() -> None:
    beam = build_beam(Payload(element_count=5, axial_load="first-order"))
    G = geometric_matrices(L, RHO, 5, "pinned-pinned")
    for found, nodal in zip(beam.axial, G, strict=False):
        np.testing.assert_array_equal(found, found.T)
        exact = beam.modes.V.T @ nodal @ beam.modes.V
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12 * np.abs(exact).max())
    assert build_beam(Payload(element_count=5)).axial.shape == (4, 0, 0)


@pytest.mark.parametrize("boundary", BUCKLING)
def test_the_beam_buckles_at_its_critical_load(boundary: str) -> None:
    assert critical_load(8, boundary) == pytest.approx(buckling_load(L, EI, boundary), rel=1e-3)


@pytest.mark.parametrize("share", [-1.99, -1.0, -0.2, 0.1, 0.5, 0.8, 0.949])
def test_a_squeezed_beam_rings_more_slowly_and_a_stretched_one_faster(share: float) -> None:
    free = squeezed_frequency(8, 0.0)
    assert squeezed_frequency(8, share) == pytest.approx(free * np.sqrt(1 - share), rel=1e-3)


@pytest.mark.parametrize(("gamma", "value"), SPUN.items())
def test_a_spun_cantilever_gets_stiffer(gamma: float, value: float) -> None:
    assert spun_frequency(8, gamma) == pytest.approx(value, rel=1e-3)


def test_without_the_axial_force_a_spun_cantilever_gets_softer_until_it_has_no_stiffness() -> None:
    assert spun_frequency(8, 3.516, felt=False) == pytest.approx(0, abs=0.05)
    assert spun_frequency(8, 2.0, felt=False) < spun_frequency(8, 0.0) < spun_frequency(8, 2.0)
