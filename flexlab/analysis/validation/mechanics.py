"""The equations of motion, the law and the forces, against mass points: Lagrange's equations hold along a general motion."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from flexlab.analysis.validation.check import FINE, Check, Runs, above, alike, below, general
from flexlab.analysis.validation.mass_points import MassPoints, christoffel, slopes, time_derivative
from flexlab.physics.internal_force import payload_matrices
from flexlab.sim.build import build_beam
from flexlab.sim.samples import Run

SUBJECT, PLACE = "Mechanics of mass points", 2

EVERY = 75
"""Of the fine run, which instants are looked at."""
DAMPING = 0.1
"""The paper's, on q̇."""


def checks(runs: Runs) -> Iterator[Check]:
    """For the paper's boundary, and for one without symmetry."""
    for run in (runs.general_pinned, runs.general):
        for check in _of(run):
            yield replace(check, statement=f"{run.scenario.payload.boundary}: {check.statement}")
    yield from _dampings()


def _of(run: Run) -> Iterator[Check]:
    """Inertia, Lagrange's equations, joint torques; along 3 ms of a fast, bent, heavy motion."""
    points = MassPoints(run.scenario)
    p = np.hstack([run.pose, run.beam_coordinates])
    rate = np.hstack([run.pose_rate, run.beam_rates])
    rows = range(2, len(run) - 2, EVERY)
    yield from _inertia(run, points, p, rate)
    energy = [0.5 * rate[k] @ points.inertia(p[k]) @ rate[k] for k in rows]
    yield alike("kinetic energy is ½ Σ m |Ṙ|²: relative error", 1e-10, energy, run.kinetic_energy[rows])
    potential = np.array([points.potential(p[k]) for k in rows])
    stored = run.elastic_energy[rows] + run.gravity_energy[rows]
    yield alike("bending and weight store what mass points do: relative error", 1e-10, potential, stored)

    error = lagrange_residual(run, points, DAMPING * np.eye(p.shape[1] - 3))
    yield below("Lagrange's equations (16) hold for x0, y0, θ: relative residual", 1e-6, error[:3].max())
    yield below("and for the beam's q: relative residual", 1e-6, error[3:].max())
    changes, accelerations = time_derivative(run.pose_rate, FINE), run.pose_acceleration
    yield alike("the sampled ẍ is the change of ẋ: relative error", 1e-6, changes, accelerations[2:-2], accelerations)
    turning = time_derivative(run.joint_angle, FINE)
    joints = np.einsum("nij,nij->n", run.joint_torque[2:-2], turning)
    inputs = np.einsum("nij,nj->n", run.arm_input[2:-2], run.pose_rate[2:-2])
    yield alike("joint torques give the power Σ τᵀθ̇ = Σ uᵀẋ: relative error", 1e-6, joints, inputs)


def lagrange_residual(run: Run, points: MassPoints, D: np.ndarray) -> np.ndarray:
    """Largest d(∂T/∂ṗ)/dt - ∂T/∂p + ∂V/∂p - (Σu, -D q̇) of each coordinate, as a part of its momentum's change, (3 + n_q,)."""
    p, rate = np.hstack([run.pose, run.beam_coordinates]), np.hstack([run.pose_rate, run.beam_rates])
    momentum = np.array([points.inertia(p[k]) @ rate[k] for k in range(len(run))])
    change = time_derivative(momentum, FINE)
    residual = []
    for k in range(2, len(run) - 2, EVERY):
        kinetic = slopes(lambda at, v=rate[k]: np.array(0.5 * v @ points.inertia(at) @ v), p[k])
        stored = slopes(lambda at: np.array(points.potential(at)), p[k])
        force = np.concatenate([run.arm_input[k].sum(axis=0), -D @ rate[k, 3:]])
        residual.append(change[k - 2] - kinetic + stored - force)
    return np.abs(residual).max(axis=0) / np.abs(change).max(axis=0)


def _dampings() -> Iterator[Check]:
    """The other kinds of damping: C = β K_F, and 2ζω of every mode, from matrices of mass points."""
    for words, field, number in (("stiffness", "coefficient", 1e-5), ("modal", "ratio", 0.2)):
        run = general(f"the run with {words} damping", payload__damping={"kind": words, field: number})
        points, n = MassPoints(run.scenario), run.beam_rates.shape[1]
        straight = np.concatenate([run.pose[0], np.zeros(n)])
        K = slopes(lambda at, of=points: slopes(lambda q: np.array(of.potential(q)), at), straight)[3:, 3:]
        M = points.payload_inertia(straight)[3:, 3:]
        square, V = eigh(K, M)
        D = number * K if words == "stiffness" else M @ V * (2 * number * np.sqrt(square)) @ V.T @ M
        error = lagrange_residual(run, points, D)
        yield below(f"{words} damping acts on the beam as it should: relative residual", 1e-6, error.max())


def _inertia(run: Run, points: MassPoints, p: np.ndarray, rate: np.ndarray) -> Iterator[Check]:
    beam, state, v = build_beam(run.scenario.payload).matrices, p[50], rate[50]
    A, B, _ = payload_matrices(beam, state[:3], v[:3], state[3:], v[3:])
    exact = points.payload_inertia(state)
    yield alike("A(p) of Eq. (8) is that of mass points: relative error", 1e-10, A, exact)
    yield above("A(p) is positive definite: least eigenvalue", 0.0, np.linalg.eigvalsh(A).min())

    def inertia(t: float) -> np.ndarray:
        moved = state + t * v
        return payload_matrices(beam, moved[:3], v[:3], moved[3:], v[3:])[0]

    h = 1e-3
    A_dot = (8 * (inertia(h) - inertia(-h)) - (inertia(2 * h) - inertia(-2 * h))) / (12 * h)
    skew = A_dot - 2 * B
    yield below("Ȧ - 2B is skew: largest entry of its symmetric part", 1e-9, skew + skew.T)
    by_points = christoffel(points.payload_inertia, state, v)
    yield alike("B is the Christoffel matrix of A: relative error", 1e-7, by_points, B)
