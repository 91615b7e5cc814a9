"""The stability proof of Section III, step by step, along simulated runs.

Notation of Eqs. (19)-(24): M̄ = ΣM̄_i + Ā with Ā = A11 - A12 A22⁻¹A21 at q = 0 is what the controller knows; Ψ is
everything else that acts on the pose, here from the true q, q̇ and dense nodal matrices:

    Ψ = -(B11 ẋ + B12 q̇) + A12 A22⁻¹(B21 ẋ + B22 q̇ + K_F q + D q̇) - (A11 - A12 A22⁻¹A21 - Ā) ẍ + ½ (dĀ/dt) s

(the last term because Ā has no velocity matrix of its own in Eq. 25). b_0 = b_1 = b_2 = b is the least common bound with
‖Ψ‖ ≤ b (1 + ‖x‖ + ‖ẋ‖²) outside the boundary layer. Then V = ½sᵀM̄s + ½Σk_j(b - b̂_j)² must fall, at least as fast as
sᵀKs. The second run adapts 10⁴ times faster, so that b̂ and ū3 matter; the third also has almost no feedback K, so that the
beam's reaction alone would make s grow.
"""

from typing import NamedTuple

import numpy as np
import pytest

from flexlab.physics.dynamics import configure_arms
from flexlab.physics.internal_force import payload_matrices
from flexlab.physics.plant import make_workspace
from flexlab.presets import load_preset
from flexlab.sim.build import nodal_damping_matrix
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

PERIOD = 2e-5
"""Sample period, s: fine enough for differences of V."""


class Proof(NamedTuple):
    """Quantities of the proof at the samples outside the boundary layer."""

    samples: Samples
    s: np.ndarray
    Psi: np.ndarray
    """(N, 3)."""
    V: np.ndarray
    dissipation: np.ndarray
    """sᵀKs, (N,)."""
    predicted: np.ndarray
    """V̇ by the proof's equality, before any bound is used, (N,)."""


def rigid_payload(beam, theta: float) -> np.ndarray:
    """Ā(θ)."""
    n = len(beam.h)
    A, _, _ = payload_matrices(beam, np.array([0, 0, theta]), np.zeros(3), np.zeros(n), np.zeros(n))
    return A[:3, :3] - A[:3, 3:] @ np.linalg.solve(A[3:, 3:], A[3:, :3])


RUNS = {"paper": (200.0, 10.0), "fast-adaptation": (200.0, 1e-3), "weak-feedback": (2.0, 1e-3)}
"""K and k_j."""


@pytest.fixture(scope="module", params=RUNS)
def proof(request) -> Proof:
    """Quantities of the proof along a run, from the start to the boundary layer."""
    gain, adaptation = RUNS[request.param][0], np.full(3, RUNS[request.param][1])
    changes = {"controller.feedback_gain": gain, "controller.adaptation": adaptation}
    world = World(load_preset("paper").replace(changes), PERIOD)
    samples = world.run(round(0.2 / PERIOD))
    law, beam, plant = world.scenario.controller, world.beam.matrices, world.system.plant
    outside = np.linalg.norm(samples.sliding_variable, axis=1) > law.boundary_layer
    samples = samples.slice(0, len(samples) if outside.all() else int(np.argmin(outside)))
    D, K = nodal_damping_matrix(world.beam), np.full(3, law.feedback_gain)
    workspace = make_workspace(len(plant.arms), plant.modal.shape[1])
    arms = workspace.arm
    Psi, kinetic, growth = [], [], []
    for k in range(len(samples)):
        x, v, a = samples.pose[k], samples.pose_rate[k], samples.pose_acceleration[k]
        q, q_dot, s = samples.beam_coordinates[k], samples.beam_rates[k], samples.sliding_variable[k]
        A, B, _ = payload_matrices(beam, x, v, q, q_dot)
        vibration = B[3:, :3] @ v + B[3:, 3:] @ q_dot + beam.K_F @ q + D @ q_dot
        coupling = A[:3, 3:] @ np.linalg.solve(A[3:, 3:], np.column_stack([vibration, A[3:, :3]]))
        known, h = rigid_payload(beam, x[2]), 1e-4
        known_rate = (rigid_payload(beam, x[2] + h) - rigid_payload(beam, x[2] - h)) / (2 * h) * v[2]
        unknown = A[:3, :3] - coupling[:, 1:] - known
        Psi.append(coupling[:, 0] - B[:3, :3] @ v - B[:3, 3:] @ q_dot - unknown @ a + known_rate @ s / 2)
        assert configure_arms(plant, x, arms, workspace.fault) == 0
        kinetic.append(s @ (arms.M.sum(axis=0) + known) @ s / 2)
        size, speed2 = np.linalg.norm(x), v @ v
        growth.append([1.0, size, speed2])
    Psi, growth, s = np.array(Psi), np.array(growth), samples.sliding_variable
    norm = np.linalg.norm(s, axis=1)
    b = float((np.linalg.norm(Psi, axis=1) / growth.sum(axis=1)).max())
    missing = b - samples.bound_estimates
    V = np.array(kinetic) + (adaptation * missing**2).sum(axis=1) / 2
    dissipation = (K * s**2).sum(axis=1)
    robust = norm * (samples.bound_estimates * growth).sum(axis=1)
    adapting = norm * (missing * growth).sum(axis=1)
    predicted = -dissipation - robust + (s * Psi).sum(axis=1) - adapting
    return Proof(samples, s, Psi, V, dissipation, predicted)


def slope(V: np.ndarray) -> np.ndarray:
    """dV/dt at inner samples by central differences of order 4."""
    return (8 * (V[3:-1] - V[1:-3]) - (V[4:] - V[:-4])) / (12 * PERIOD)


def test_psi_is_large_and_acts_for_long(proof: Proof):
    """Otherwise the tests below would prove little."""
    assert len(proof.Psi) > 1000
    assert np.linalg.norm(proof.Psi, axis=1).max() > 10


def test_the_closed_loop_obeys_the_equality_of_the_proof(proof: Proof):
    """V̇ = -sᵀKs + sᵀū3 + sᵀΨ - Σk_j b̃_j db̂_j/dt: dynamics, law and adaptation together, by differences of V."""
    found, expected = slope(proof.V), proof.predicted[2:-2]
    assert np.abs(found - expected).max() < 1e-7 * np.abs(expected).max()


def test_v_falls_at_least_as_fast_as_the_proof_says(proof: Proof):
    """V̇ ≤ -sᵀKs < 0 outside the boundary layer while the bound holds (Eq. 24)."""
    found, limit = slope(proof.V), -proof.dissipation[2:-2]
    assert np.all(limit < 0)
    assert np.all(found <= limit + 1e-7 * np.abs(proof.predicted).max())
    assert np.all(np.diff(proof.V) < 0)


@pytest.mark.parametrize("proof", ["weak-feedback"], indirect=True)
def test_the_beams_reaction_alone_would_drive_s_up(proof: Proof):
    """The tests above are not vacuous: without ū3, sᵀΨ - sᵀKs is positive at times, and with it V still falls."""
    assert ((proof.s * proof.Psi).sum(axis=1) - proof.dissipation).max() > 0
