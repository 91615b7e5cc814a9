"""The payload's inertia matrix, Christoffel matrix and weight, each against its definition."""

import numpy as np
import pytest
from reference.lagrangian import Lagrangian, gradient

from flexlab.physics.beam import BeamMatrices, free_coordinates
from flexlab.physics.internal_force import payload_matrices
from flexlab.scenario import Arm, Payload, Scenario
from flexlab.sim.build import build_beam

BOUNDARIES = ["pinned-pinned", "clamped-clamped", "clamped-pinned", "pinned-clamped"]
MASSLESS = {"link_mass": (0, 0, 0), "link_inertia": (1e-300,) * 3}


def payload_alone(n: int, boundary: str, gravity: float) -> tuple[BeamMatrices, Lagrangian]:
    """A payload on arms without mass, so that L is the payload's."""
    payload = Payload(element_count=n, boundary=boundary, length=0.7, linear_density=1.3, bending_stiffness=20.0)
    left, right = Arm(base=(-0.5, 0), elbow=-1, **MASSLESS), Arm(base=(0.5, 0), elbow=1, **MASSLESS)
    scenario = Scenario(payload=payload, left_arm=left, right_arm=right, gravity=gravity)
    held = np.setdiff1d(np.arange(2 * n + 2), free_coordinates(n, boundary))
    return build_beam(payload).matrices, Lagrangian(scenario, held.tolist())


def states(n_q: int, count: int, seed: int):
    """Random pose (in reach), pose rate, q, q̇."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield rng.uniform([-0.1, 0.7, -0.4], [0.1, 0.8, 0.4]), rng.normal(size=3), *rng.normal(size=(2, n_q))


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("n", [2, 3, 6])
def test_kinetic_energy_is_that_of_the_moving_mass(n: int, boundary: str):
    """½ṗᵀA(p)ṗ = ½∫ρ|Ṙ|²ds, with Ṙ from complex-step differentiation of the points' positions."""
    beam, lagrangian = payload_alone(n, boundary, 0.0)
    for pose, rate, q, q_dot in states(len(beam.h), 10, seed=n):
        A, _, _ = payload_matrices(beam, pose, rate, q, q_dot)
        p_rate = np.concatenate([rate, q_dot])
        expected = lagrangian.kinetic(np.concatenate([pose, q]), p_rate)
        assert p_rate @ A @ p_rate / 2 == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_inertia_matrix_is_symmetric_and_positive_definite(n: int):
    """Property 1 of Eq. (16)."""
    beam, _ = payload_alone(n, "pinned-pinned", 0.0)
    for pose, rate, q, q_dot in states(len(beam.h), 20, seed=n):
        A, _, _ = payload_matrices(beam, pose, rate, q, q_dot)
        np.testing.assert_allclose(A, A.T, rtol=0, atol=1e-16)
        assert np.linalg.eigvalsh(A).min() > 0


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize("n", [2, 4])
def test_inertia_rate_less_twice_the_velocity_matrix_is_skew(n: int, boundary: str):
    """Property 2: Ȧ - 2B is skew to 1e-10, with Ȧ from central differences of order 4 along the motion."""
    beam, _ = payload_alone(n, boundary, 0.0)
    for pose, rate, q, q_dot in states(len(beam.h), 20, seed=n):
        _, B, _ = payload_matrices(beam, pose, rate, q, q_dot)

        def inertia(t, pose=pose, rate=rate, q=q, q_dot=q_dot):
            return payload_matrices(beam, pose + t * rate, rate, q + t * q_dot, q_dot)[0]

        h = 1e-3
        A_dot = (8 * (inertia(h) - inertia(-h)) - (inertia(2 * h) - inertia(-2 * h))) / (12 * h)
        N = A_dot - 2 * B
        assert np.abs(N + N.T).max() < 1e-10 * max(1, np.abs(B).max())


def test_velocity_matrix_is_the_christoffel_matrix():
    """B_ij = ½Σ_k(∂_k A_ij + ∂_j A_ik - ∂_i A_jk) ṗ_k: skewness alone would allow other choices."""
    beam, _ = payload_alone(3, "pinned-pinned", 0.0)
    for pose, rate, q, q_dot in states(len(beam.h), 5, seed=3):
        p, p_rate = np.concatenate([pose, q]), np.concatenate([rate, q_dot])
        size = len(p)

        def inertia(at, rate=rate, q_dot=q_dot):
            return payload_matrices(beam, at[:3], rate, at[3:], q_dot)[0]

        dA = np.zeros((size, size, size))
        for k in range(size):
            d = np.zeros(size)
            d[k] = 1e-3
            near, far = inertia(p + d) - inertia(p - d), inertia(p + 2 * d) - inertia(p - 2 * d)
            dA[k] = (8 * near - far) / 12e-3
        first, second = np.einsum("kij,k->ij", dA, p_rate), np.einsum("jik,k->ij", dA, p_rate)
        expected = (first + second - second.T) / 2
        _, B, _ = payload_matrices(beam, pose, rate, q, q_dot)
        np.testing.assert_allclose(B, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("n", [2, 5])
def test_weight_is_the_gradient_of_its_potential(n: int):
    """[0, m g, -g sin θ w̄, g cos θ h] = ∂U/∂p."""
    beam, lagrangian = payload_alone(n, "pinned-pinned", 9.81)
    for pose, rate, q, q_dot in states(len(beam.h), 5, seed=n):
        p = np.concatenate([pose, 0.1 * q])
        expected = gradient(lagrangian.potential, p, 1e-3)
        expected[3:] -= beam.K_F @ p[3:]
        _, _, weight = payload_matrices(beam, pose, rate, p[3:], q_dot, 9.81)
        np.testing.assert_allclose(weight, expected, rtol=0, atol=1e-9 * max(1, np.abs(beam.K_F @ q).max()))
