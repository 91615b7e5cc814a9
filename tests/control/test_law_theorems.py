"""What the theorem of each law says about its V, along simulated runs, against an independent plant.

Ψ is the force that the plant needs beyond the law's model: Ψ = B ẍ + C̄ẋ + Ḡ - Σu_i + ½ (dĀ/dt) s, with ẍ from
`reference.flexible_system`; V is differentiated along the engine's samples.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from reference.control_laws import LAWS, start, truth
from reference.flexible_system import FlexibleSystem, Seen, inverse_kinematics
from reference.terms import random_scenario

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

PERIOD = 2e-5
"""Sample period, s: fine enough for differences of V."""
DURATION = 0.03
"""Duration of a run, s."""


class Proof(NamedTuple):
    """Quantities along a run of N samples."""

    scenario: Scenario
    samples: Samples
    s: np.ndarray
    Psi: np.ndarray
    """(N, 3)."""
    d: np.ndarray
    """Disturbance of the momentum balance dp/dt = Σu_i + C̄ᵀẋ - Ḡ + d, p = Bẋ, (N, 3)."""
    kinetic: np.ndarray
    """½ sᵀBs, (N,)."""
    true_kinetic: np.ndarray
    """½ sᵀ(ΣM̄_i + diag(m, m, I))s with the true payload, (N,)."""
    true_Psi: np.ndarray
    """Ψ of the true rigid payload, (N, 3)."""


def memory_of(scenario: Scenario, seen: Seen, samples: Samples, k: int) -> np.ndarray:
    """The law's memory at sample k, recovered from its signals."""
    law, own = scenario.controller, samples.own
    if law.kind == "super-twisting":
        return own["twisting_force"][k]
    if law.kind == "disturbance-observer":
        return np.concatenate([start(seen)[:3] - own["disturbance_estimate"][k] / law.observer_gain, np.zeros(3)])
    if law.kind == "regressor-adaptive":
        named = ("payload_mass_estimate", "payload_inertia_estimate", "link_mass_estimates")
        return np.concatenate([own[name][k].ravel() for name in named])
    return samples.bound_estimates[k]


def prove(kind: str, **gains) -> Proof:
    """Run a law on two different arms with a soft beam, gravity and a wrong belief."""
    changes = {
        "controller.kind": kind,
        **{f"controller.{name}": value for name, value in gains.items()},
        "controller.model.linear_density_factor": 1.2,
        "payload.bending_stiffness": 20.0,
        "trajectory.amplitude": (0.1, 0.1, 0.1),
        "simulation.accuracy": 1e-12,
    }
    scenario = random_scenario(3).replace(changes)
    samples = World(scenario, PERIOD).run(round(DURATION / PERIOD))
    system, n = FlexibleSystem(scenario, LAWS[kind], start), scenario.payload.coordinate_count
    m, inertia = truth(system.see(0.0, system.begin()))[:2]
    rows = []
    for k in range(len(samples)):
        x, v = samples.pose[k], samples.pose_rate[k]
        state = np.concatenate([x, v, samples.beam_coordinates[k], samples.beam_rates[k]])
        seen = system.see(float(samples.time[k]), state)
        u = system.inputs(seen, memory_of(scenario, seen, samples, k))[0]
        a = system.accelerations(seen, state, u)[:3]
        M, C, G = (part.sum(0) for part in seen.sums())
        B, true_B = M + seen.A, M + np.diag([m, m, inertia])
        h, weight = 1e-4, np.array([0, scenario.gravity, 0])
        turned = [system.believed_inertia(x[2] + e) for e in (h, -h)]
        A_rate = (turned[0] - turned[1]) / (2 * h) * v[2]
        s = samples.sliding_variable[k]
        rest = C @ v + G - u.sum(0)
        force = B @ a + rest + system.m * weight
        rows.append(
            [
                s,
                force + A_rate @ s / 2,
                force + A_rate @ v,
                s @ B @ s / 2,
                s @ true_B @ s / 2,
                true_B @ a + rest + m * weight,
            ]
        )
    assert len(state) == 6 + 2 * n
    s, Psi, d, kinetic, true_kinetic, true_Psi = (np.array(column) for column in zip(*rows, strict=True))
    return Proof(scenario, samples, s, Psi, d, kinetic, true_kinetic, true_Psi)


def slope(V: np.ndarray) -> np.ndarray:
    """dV/dt at inner samples by central differences of order 4."""
    return (8 * (V[3:-1] - V[1:-3]) - (V[4:] - V[:-4])) / (12 * PERIOD)


def agrees(V: np.ndarray, expected: np.ndarray, kinks: Sequence[int] = ()) -> None:
    """Assert that dV/dt is as expected, except where a kink of it, after one of the samples `kinks`, is within the stencil."""
    found, expected = slope(V), expected[2:-2]
    error = np.abs(found - expected) / np.abs(expected).max()
    for k in kinks:
        error[k - 3 : k + 1] = 0
    assert error.max() < 1e-6, np.flatnonzero(error > 1e-6) + 2


def test_v_of_sliding_mode_falls_at_least_as_fast_as_its_feedback_says():
    """V = ½ sᵀBs: dV/dt = -sᵀKs - ρ̂‖s‖²/max(‖s‖, ε) + sᵀΨ ≤ -sᵀKs outside the layer, as ρ̂ ≥ ‖Ψ‖."""
    K, bound, layer = np.array([150.0, 200.0, 40.0]), 60.0, 0.8
    proof = prove("sliding-mode", feedback_gain=tuple(K), bound=bound, boundary_layer=layer)
    norm, feedback = np.linalg.norm(proof.s, axis=1), proof.s**2 @ K
    assert 5 < np.linalg.norm(proof.Psi, axis=1).max() < bound
    enters = np.flatnonzero(np.diff(norm > layer))
    assert len(enters) == 1
    expected = -feedback - bound * norm**2 / np.maximum(norm, layer) + (proof.s * proof.Psi).sum(1)
    agrees(proof.kinetic, expected, enters)
    outside = norm > 1.01 * layer
    assert 200 < np.sum(outside) < len(norm) - 20
    assert np.all(slope(proof.kinetic)[outside[2:-2]] < -feedback[2:-2][outside[2:-2]])


def test_v_of_super_twisting_within_its_layer_obeys_its_theorem():
    """V = ½ sᵀBs + ε‖w + Ψ‖²/(2 k2): dV/dt = -k1‖s‖²/√ε + (ε/k2)(w + Ψ)·dΨ/dt."""
    k1, k2, layer = 80.0, 300.0, 4.0
    proof = prove("super-twisting", proportional_gain=k1, integral_gain=k2, boundary_layer=layer)
    lacking = proof.samples["twisting_force"] + proof.Psi
    V = proof.kinetic + layer / (2 * k2) * (lacking**2).sum(1)
    change = np.zeros_like(proof.Psi)
    change[2:-2] = np.stack([slope(column) for column in proof.Psi.T], axis=1)
    expected = -k1 * (proof.s**2).sum(1) / np.sqrt(layer) + layer / k2 * (lacking * change).sum(1)
    agrees(V, expected)


def test_super_twisting_outside_its_layer_obeys_its_theorem():
    """d(½ sᵀBs)/dt = -k1‖s‖^{3/2} + sᵀ(w + Ψ), and dw/dt = -k2 s/‖s‖."""
    k1, k2 = 80.0, 300.0
    proof = prove("super-twisting", proportional_gain=k1, integral_gain=k2, boundary_layer=1e-3)
    norm, w = np.linalg.norm(proof.s, axis=1), proof.samples["twisting_force"]
    agrees(proof.kinetic, -k1 * norm**1.5 + (proof.s * (w + proof.Psi)).sum(1))
    for a in range(3):
        agrees(w[:, a], -k2 * proof.s[:, a] / norm)


def test_the_observer_filters_the_disturbance():
    """dd̂/dt = ℓ (d - d̂) whatever the motion, and d(½ sᵀBs)/dt = -sᵀKs + sᵀ(Ψ - d̂)."""
    gain, K = 60.0, 150.0
    proof = prove("disturbance-observer", observer_gain=gain, feedback_gain=K)
    d_hat = proof.samples["disturbance_estimate"]
    np.testing.assert_array_equal(d_hat[0], 0)
    for a in range(3):
        agrees(d_hat[:, a], gain * (proof.d - d_hat)[:, a])
    agrees(proof.kinetic, -K * (proof.s**2).sum(1) + (proof.s * (proof.Psi - d_hat)).sum(1))


def test_v_of_the_regressor_law_changes_by_feedback_and_bending_alone():
    """V = ½ sᵀ(ΣM̄_i + diag(m, m, I))s + ½ ãᵀΓ⁻¹ã: dV/dt = -sᵀKs + sᵀΨ, where Ψ comes from the beam's bending alone."""
    K = 150.0
    proof = prove("regressor-adaptive", feedback_gain=K)
    law, samples = proof.scenario.controller, proof.samples
    system = FlexibleSystem(proof.scenario, LAWS[law.kind], start)
    wrong = [samples["payload_mass_estimate"][:, None], samples["payload_inertia_estimate"][:, None]]
    wrong = np.hstack([*wrong, samples["link_mass_estimates"]]) - truth(system.see(0.0, system.begin()))
    gains = np.array([law.adaptation_gain_mass, law.adaptation_gain_inertia, *6 * [law.adaptation_gain_links]])
    V = proof.true_kinetic + (wrong**2 / gains).sum(1) / 2
    agrees(V, -K * (proof.s**2).sum(1) + (proof.s * proof.true_Psi).sum(1))
    assert np.abs(wrong[-1] - wrong[0]).max() > 0.1, "it learns"


def test_under_joint_pd_the_energy_of_motion_and_error_only_falls():
    """With the target at rest, T + U + ½ Σ ΔθᵀPΔθ falls by exactly what D and the beam's damping dissipate."""
    P, D = np.array([9000.0, 7000.0, 900.0]), np.array([300.0, 200.0, 50.0])
    changes = {
        "controller.kind": "joint-pd",
        "controller.position_gain": tuple(P),
        "controller.velocity_gain": tuple(D),
        "trajectory.amplitude": (0.0, 0.0, 0.0),
        "initial.pose": (0.1, 0.8, 0.2),
        "initial.beam_coordinates": (0.05, 0.006, -0.02, -0.03),
    }
    scenario = load_preset("paper").replace(changes)
    samples = World(scenario, 1e-4).run(4000)
    desired = np.array(scenario.trajectory.center)
    wanted = np.array([np.diff(inverse_kinematics(scenario, i, desired), prepend=0) for i in range(2)])
    error = samples.joint_angle - wanted
    V = samples.total_energy + (P * error**2).sum(axis=(1, 2)) / 2
    rate = np.gradient(samples.joint_angle, 1e-4, axis=0, edge_order=2)
    taken = (D * rate**2).sum(axis=(1, 2))
    taken = np.concatenate([[0], np.cumsum((taken[1:] + taken[:-1]) / 2) * 1e-4]) + samples.dissipated_energy
    assert np.all(np.diff(V) <= 1e-12 * V[0])
    np.testing.assert_allclose(V + taken, V[0], rtol=1e-4)
    assert V[-1] < 1e-3 * V[0]
