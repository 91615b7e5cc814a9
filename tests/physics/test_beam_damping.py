"""The three kinds of damping: the ratio that each gives to the modes, and which of them depends on the mesh."""

import numpy as np
import pytest

from flexlab.scenario import Payload
from flexlab.scenario.payload import ModalDamping, NodalDamping, StiffnessDamping
from flexlab.sim.build import build_beam, nodal_damping_matrix


def ratios(payload: Payload, count: int) -> np.ndarray:
    """Damping ratios ζ of the lowest modes, from the eigenvalues of M q̈ + D q̇ + K q = 0."""
    beam = build_beam(payload)
    M, K, D = beam.matrices.M_q, beam.matrices.K_F, nodal_damping_matrix(beam)
    n = len(M)
    first_order = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    poles = np.linalg.eigvals(first_order)
    poles = poles[poles.imag > 0]
    poles = poles[np.argsort(np.abs(poles))][:count]
    return -poles.real / np.abs(poles)


@pytest.mark.parametrize("n", [2, 4, 9, 16])
@pytest.mark.parametrize("boundary", ["pinned-pinned", "clamped-pinned", "clamped-clamped"])
def test_modal_damping_is_the_same_ratio_for_every_mode_and_mesh(n: int, boundary: str):
    """ζ_k = ζ for any n and boundary."""
    payload = Payload(element_count=n, boundary=boundary, damping=ModalDamping(ratio=0.03))
    np.testing.assert_allclose(ratios(payload, 3)[: payload.coordinate_count], 0.03, rtol=1e-6)


def test_stiffness_damping_grows_with_the_modes_frequency():
    """C = βK_F: ζ_k = β ω_k / 2."""
    payload = Payload(element_count=6, damping=StiffnessDamping(coefficient=2e-5))
    omega = np.sort(build_beam(payload).modes.omega)[:4]
    np.testing.assert_allclose(ratios(payload, 4), 1e-5 * omega, rtol=1e-6)
    beam = build_beam(payload)
    scale = np.abs(beam.matrices.K_F).max()
    np.testing.assert_allclose(nodal_damping_matrix(beam), 2e-5 * beam.matrices.K_F, rtol=0, atol=2e-5 * 1e-9 * scale)


@pytest.mark.parametrize("boundary", ["pinned-pinned", "clamped-pinned", "clamped-free"])
@pytest.mark.parametrize("n", [2, 5, 64])
def test_nodal_damping_is_the_papers_unit_matrix(n: int, boundary: str):
    """D = c·1 over all nodal rates, even when computed back from the modes."""
    beam = build_beam(Payload(element_count=n, boundary=boundary, damping=NodalDamping(coefficient=0.1)))
    np.testing.assert_allclose(nodal_damping_matrix(beam), 0.1 * np.eye(len(beam.matrices.M_q)), rtol=0, atol=1e-9)


def test_nodal_damping_depends_on_the_mesh():
    """This is why the other two kinds exist: with c on every node, more nodes damp the first mode more."""
    coarse, fine = (ratios(Payload(element_count=n), 1)[0] for n in (2, 8))
    assert fine > 1.5 * coarse


@pytest.mark.parametrize(
    ("boundary", "blocks"), [("pinned-pinned", 2), ("clamped-clamped", 2), ("clamped-pinned", 1), ("clamped-free", 1)]
)
@pytest.mark.parametrize("n", [4, 64])
def test_nodal_damping_couples_only_modes_of_the_same_symmetry(n: int, boundary: str, blocks: int):
    """Symmetric and antisymmetric modes stay uncoupled if both ends are alike, which halves the work of a step."""
    modes = build_beam(Payload(element_count=n, boundary=boundary)).modes
    assert len(modes.block_start) - 1 == blocks


@pytest.mark.parametrize("damping", [ModalDamping(), StiffnessDamping(), NodalDamping(coefficient=0.0)])
def test_other_damping_couples_no_modes(damping):
    """There is one mode per block, so the cost of a step is linear in n."""
    modes = build_beam(Payload(element_count=64, damping=damping)).modes
    assert len(modes.block_start) - 1 == len(modes.omega)
