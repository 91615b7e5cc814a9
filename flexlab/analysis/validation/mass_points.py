"""Arms and beam as mass points whose positions follow from p = (x0, y0, θ, q): mechanics without the engine's matrices.

No mass matrix, Jacobian, Christoffel symbol or modal coordinate of the engine is used: inertia is Σ m |∂R/∂p|², found by
complex steps, and all else follows from it and from potentials by differences.
"""

from collections.abc import Callable
from copy import copy

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.linalg import eigh

from flexlab.analysis.validation.check import CENTER, DAMPING, EVERY, FINE
from flexlab.scenario import Scenario
from flexlab.sim.commands import Pull
from flexlab.sim.samples import Run, Samples

COMPLEX_STEP = 1e-30
"""Step with which derivatives of positions are exact."""
STEP = 1e-4
"""Step of fourth-order differences, m and rad."""
GAUSS_POINTS = 6
"""Per element, exact for the beam's kinetic energy."""
HELD = {"pinned-pinned": (0, -2), "pinned-clamped": (0, -2, -1), "clamped-pinned": (0, 1, -2)}
"""Boundary → which of the 2 (n + 1) nodal coordinates are zero."""


class MassPoints:
    """A scenario with two arms and one of the boundaries of `HELD`."""

    def __init__(self, scenario: Scenario, hand: Pull | None = None):
        """`hand`: a spring that holds the beam."""
        payload, self._hand = scenario.payload, hand
        self._payload = payload
        self._arms, self.gravity = scenario.arms, scenario.gravity
        self._mass = np.array([arm.link_mass for arm in scenario.arms])
        self._turning = np.array([arm.inertia for arm in scenario.arms])
        n, half = payload.element_count, payload.length / 2
        x, weight = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        edges = np.linspace(-half, half, n + 1)
        cells = edges if hand is None else np.union1d(edges, [hand.position])
        middle, width = (cells[1:] + cells[:-1]) / 2, np.diff(cells)[:, None] / 2
        self.places = (middle[:, None] + width * x).ravel()
        self._weight = (width * weight).ravel()
        # Cubics between the nodes: N(s), N'(s), N''(s) of the free coordinates, (points, n_q) each.
        free = np.delete(np.eye(2 * n + 2), HELD[payload.boundary], axis=1)
        self.shapes = CubicHermiteSpline(edges, free[0::2], free[1::2])
        self._N, self._N1, self._N2 = (self.shapes(self.places, order) for order in range(3))

    @property
    def density(self) -> float:
        """Mass per length of the payload, kg/m."""
        return self._payload.linear_density

    def payload_inertia(self, p: np.ndarray) -> np.ndarray:
        """A(p) of the payload alone, Eq. (8)."""
        mass = self._payload.linear_density * self._weight
        J = jacobian(self._beam, p)
        return np.einsum("k,aki,akj->ij", mass, J, J)

    def arm_inertia(self, x: np.ndarray, index: int) -> np.ndarray:
        """M̄_i(x) of one arm, (3, 3), Eq. (13)."""
        J = jacobian(lambda pose: self._links(pose, index), x)
        centers, directions = J[:, :3], J[:, 3:]
        M = np.einsum("k,aki,akj->ij", self._mass[index], centers, centers)
        # |d(unit vector)| is the link's rotation.
        return M + np.einsum("k,aki,akj->ij", self._turning[index], directions, directions)

    def arm_terms(self, x: np.ndarray, v: np.ndarray, index: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """M̄_i, C̄_i, (3, 3), and Ḡ_i, (3,), of one arm."""
        C = christoffel(lambda at: self.arm_inertia(at, index), x, v)
        G = slopes(lambda at: np.array(self.arm_potential(at, index)), x)
        return self.arm_inertia(x, index), C, G

    def rigid_inertia(self, x: np.ndarray) -> np.ndarray:
        """A11 - A12 A22⁻¹A21 of the straight payload, (3, 3)."""
        A = self.payload_inertia(np.concatenate([x, np.zeros(self._N.shape[1])]))
        return A[:3, :3] - A[:3, 3:] @ np.linalg.solve(A[3:, 3:], A[3:, :3])

    def axial_force(self, run: Samples, k: int, change: np.ndarray, s: np.ndarray) -> np.ndarray:
        """N(s), N, of the straight link at sample k, if its pose changed with ẍ = `change`: tension is positive."""
        x, v, length = run.pose[k], run.pose_rate[k], self._payload.length
        M, C, G = self.arm_terms(x, v, 0)
        left = run.arm_input[k, 0] - M @ change - C @ v - G
        along = np.array([np.cos(x[2]), np.sin(x[2])])
        pulled, turning = along @ change[:2] + self.gravity * along[1], 0.5 * v[2] ** 2 * (length**2 / 4 - s**2)
        force = -along @ left[:2] + self._payload.linear_density * (pulled * (s + length / 2) + turning)
        if self._hand is None:
            return force
        held = self._hand.target - self.beam_point(np.concatenate([x, run.beam_coordinates[k]]), self._hand.position)
        return force - np.where(s > self._hand.position, self._hand.stiffness * along @ held, 0.0)

    def axial_stiffness(self, run: Samples, k: int, onto: np.ndarray | None = None) -> np.ndarray:
        """K_G at sample k, with N(s) of the ẍ that the payload would have without it.

        `onto`: directions, in columns, in which it moves as freely as it does; it is held in all others. None: all directions.
        """
        p, rate, _ = coordinates(run)
        inertia, q = self.inertia(p[k]), p[k, 3:]
        onto = np.eye(len(inertia)) if onto is None else onto
        gained = (onto @ np.linalg.solve(onto.T @ inertia @ onto, onto.T))[:3]
        change, give = gained @ inertia @ time_derivative(rate[k - 2 : k + 3], FINE)[0], gained[:, 3:]
        # N(s) is linear in ẍ, and K_G in N(s).
        still, *further = (
            self.axial_force(run, k, change, self.places) for change in np.vstack([np.zeros(3), np.eye(3)])
        )
        slope = np.stack([give @ self.geometric_stiffness(line - still) @ q for line in further], axis=1)
        first = change + give @ self.geometric_stiffness(still) @ q
        change = np.linalg.solve(np.eye(3) - slope, first)
        return self.geometric_stiffness(self.axial_force(run, k, change, self.places))

    def between_grips(self, x: np.ndarray, spin: float, pulls: np.ndarray) -> np.ndarray:
        """K_G of a payload at pose x that turns with `spin`, rad/s, and is held by the forces pulls (2, 3) at its ends."""
        length, along = self._payload.length, pulls[:, :2] @ [np.cos(x[2]), np.sin(x[2])]
        line = -along[0] + along.sum() * (self.places / length + 0.5)
        density = self._payload.linear_density
        return self.geometric_stiffness(line + density / 2 * spin**2 * (length**2 / 4 - self.places**2))

    def geometric_stiffness(self, force: np.ndarray) -> np.ndarray:
        """K_G for N, N, at the mass points, tension positive."""
        return np.einsum("k,ka,kb->ab", self._weight * force, self._N1, self._N1)

    def filled(self, factor: float) -> "MassPoints":
        """The same mass points with a payload whose density is `factor` times as large."""
        other, density = copy(self), factor * self._payload.linear_density
        other._payload = self._payload.model_copy(update={"linear_density": density})
        return other

    def of_one_kilogram(self, index: int, link: int) -> "MassPoints":
        """One link of one arm, with 1 kg and that link's radius of gyration, as the arm's only mass."""
        alone = copy(self)
        share = np.zeros_like(self._mass)
        share[index, link] = 1 / self._mass[index, link]
        alone._mass, alone._turning = self._mass * share, self._turning * share
        return alone

    def joint_angles(self, x: np.ndarray, index: int) -> np.ndarray:
        """Relative joint angles of one arm, rad, (3,)."""
        u = self._links(x, index)[:, 3:]
        before = np.column_stack([[1.0, 0.0], u[:, 0], u[:, 1]])
        return np.arctan2(before[0] * u[1] - before[1] * u[0], (before * u).sum(axis=0))

    def inertia(self, p: np.ndarray) -> np.ndarray:
        """Inertia matrix of arms and payload, Eq. (16)."""
        A = self.payload_inertia(p)
        for index in range(len(self._arms)):
            A[:3, :3] += self.arm_inertia(p[:3], index)
        return A

    def arm_potential(self, x: np.ndarray, index: int) -> float:
        """Potential energy of one arm's weight, J."""
        return self.gravity * float(self._mass[index] @ self._links(x, index)[1, :3])

    def payload_potential(self, p: np.ndarray) -> float:
        """Potential energy of the payload's weight and bending, J."""
        payload = self._payload
        bending = 0.5 * payload.bending_stiffness * float(self._weight @ (self._N2 @ p[3:]) ** 2)
        return bending + self.gravity * payload.linear_density * float(self._weight @ self._beam(p)[1])

    def potential(self, p: np.ndarray) -> float:
        """Potential energy of all weights, of the bending and of the hand's spring, J."""
        stored = self.payload_potential(p) + sum(self.arm_potential(p[:3], index) for index in range(len(self._arms)))
        if self._hand is None:
            return stored
        return stored + 0.5 * self._hand.stiffness * np.sum(
            (self.beam_point(p, self._hand.position) - self._hand.target) ** 2
        )

    def static_deflection(self, x: np.ndarray, change: np.ndarray) -> float:
        """Deflection at mid-span, m, of the beam at pose x that its weight and ẍ = `change` bend."""
        straight = np.concatenate([x, np.zeros(self._N.shape[1])])
        load = (
            slopes(lambda p: np.array(self.payload_potential(p)), straight)
            + self.payload_inertia(straight)[:, :3] @ change
        )
        return -float(self.shapes(0.0) @ np.linalg.solve(self.bending, load[3:]))

    def softest(self) -> float:
        """ω₁², 1/s², of the straight beam between held grips."""
        M = self.payload_inertia(np.zeros(3 + self._N.shape[1]))[3:, 3:]
        return float(eigh(self.bending, M, eigvals_only=True)[0])

    @property
    def bending(self) -> np.ndarray:
        """K_F, N/m and so on, (n_q, n_q)."""
        return self._payload.bending_stiffness * np.einsum("k,ka,kb->ab", self._weight, self._N2, self._N2)

    def beam_point(self, p: np.ndarray, s: float) -> np.ndarray:
        """Place of the beam's point at s, m, (2,)."""
        c, sine, w = np.cos(p[2]), np.sin(p[2]), self.shapes(s) @ p[3:]
        return np.array([p[0] + s * c - w * sine, p[1] + s * sine + w * c])

    def _beam(self, p: np.ndarray) -> np.ndarray:
        """Places of the beam's points for p (3 + n_q, …), (2, points, …)."""
        c, s, w = np.cos(p[2]), np.sin(p[2]), np.tensordot(self._N, p[3:], 1)
        places = self.places.reshape(-1, *[1] * (p.ndim - 1))
        return np.array([p[0] + places * c - w * s, p[1] + places * s + w * c])

    def _links(self, x: np.ndarray, index: int) -> np.ndarray:
        """Centres of mass of an arm's links and unit vectors along them for x (3, …), (2, 6, …)."""
        arm, side = self._arms[index], -1 if index == 0 else 1
        l1, l2, l3 = arm.link_length
        along = np.array([np.cos(x[2]), np.sin(x[2])])
        base = np.reshape(arm.base, (2, *[1] * (x.ndim - 1)))
        wrist = x[:2] + side * (self._payload.length / 2 + l3) * along - base
        square = wrist[0] ** 2 + wrist[1] ** 2
        cosine = (square - l1**2 - l2**2) / (2 * l1 * l2)
        near, far = l1 + l2 * cosine, l2 * arm.elbow * np.sqrt(1 - cosine**2)
        u1 = np.array([near * wrist[0] + far * wrist[1], near * wrist[1] - far * wrist[0]]) / square
        u2, u3 = (wrist - l1 * u1) / l2, -side * along
        a1, a2, a3 = arm.link_center
        centers = np.array([a1 * u1, l1 * u1 + a2 * u2, l1 * u1 + l2 * u2 + a3 * u3]) + base
        return np.concatenate([centers, [u1, u2, u3]]).swapaxes(0, 1)


def jacobian(positions, p: np.ndarray) -> np.ndarray:
    """Derivatives by p of positions, a function of several p in columns, by complex steps: (…, len(p))."""
    return positions(np.asarray(p)[:, None] + 1j * COMPLEX_STEP * np.eye(len(p))).imag / COMPLEX_STEP


def slopes(function, at: np.ndarray) -> np.ndarray:
    """∂(function)/∂p_k by differences of fourth order, k first."""
    found = []
    for step in STEP * np.eye(len(at)):
        near, far = function(at + step) - function(at - step), function(at + 2 * step) - function(at - 2 * step)
        found.append((8 * near - far) / (12 * STEP))
    return np.array(found)


def christoffel(inertia, at: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """The velocity matrix with C_ij = ½ Σ_k (∂_k A_ij + ∂_j A_ik - ∂_i A_jk) ṗ_k."""
    dA = slopes(inertia, at)
    first, second = np.einsum("kij,k->ij", dA, rate), np.einsum("jik,k->ij", dA, rate)
    return (first + second - second.T) / 2


def linear_plant(points: MassPoints) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M and K (n, n) at the path's centre, and A (2n, 2n) of d(p, ṗ)/dt = A (p, ṗ) + B f, for the paper's damping."""
    p = np.concatenate([CENTER, np.zeros(points.shapes(0.0).size)])
    M, n = points.inertia(p), len(p)
    K = slopes(lambda at: slopes(lambda q: np.array(points.potential(q)), at), p)
    K[:3], K[:, :3] = 0.0, 0.0
    D = np.diag(np.where(np.arange(n) < 3, 0.0, DAMPING))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    return M, K, A


def lagrange(inertia, potential, at: np.ndarray, rate: np.ndarray, change: np.ndarray) -> np.ndarray:
    """d(∂T/∂ṗ)/dt - ∂T/∂p + ∂V/∂p, the generalised forces of a motion; `change`: d(∂T/∂ṗ)/dt."""
    kinetic = slopes(lambda p: np.array(0.5 * rate @ inertia(p) @ rate), at)
    return change - kinetic + slopes(lambda p: np.array(potential(p)), at)


def mass_ratio(time: np.ndarray, factor: float, begin: float, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Mass ratio s and its rate ṡ with the ramp 10u³ - 15u⁴ + 6u⁵, 1 and 1/s, (N,) each."""
    ramp = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    u = np.clip((time - begin) / duration, 0.0, 1.0)
    return 1 + (factor - 1) * ramp(u), (factor - 1) * ramp.deriv()(u) / duration


def pose_by_angles(scenario: Scenario, index: int, angle: np.ndarray) -> np.ndarray:
    """Pose (N, 3) of the payload's middle, half its length beyond the grip, from an arm's relative joint angles (N, 3)."""
    arm, turned = scenario.arms[index], np.cumsum(angle, axis=1)
    outwards = np.array([*arm.link_length[:2], arm.link_length[2] + scenario.payload.length / 2])
    x, y = arm.base[0] + np.cos(turned) @ outwards, arm.base[1] + np.sin(turned) @ outwards
    return np.column_stack([x, y, turned[:, 2] - index * np.pi])


def coordinates(run: Run) -> tuple[np.ndarray, np.ndarray, range]:
    """p and ṗ of all samples of a run, (N, 3 + n_q) each, and the indices of the samples that are compared."""
    p, rate = np.hstack([run.pose, run.beam_coordinates]), np.hstack([run.pose_rate, run.beam_rates])
    return p, rate, range(2, len(run) - 2, EVERY)


def residual_force(
    run: Run, body: Callable, force: Callable[[int], np.ndarray], onto: np.ndarray | None = None
) -> np.ndarray:
    """Largest |d(∂T/∂ṗ)/dt - ∂T/∂p + ∂V/∂p - force(k)| of each coordinate over its momentum's rate, (3 + n_q,).

    `body(k)`: inertia and potential at sample k, as functions of p. `onto`: directions in which the motion is free, in columns
    (None: every coordinate's).
    """
    p, rate, rows = coordinates(run)
    change = time_derivative(np.array([body(k)[0](p[k]) @ rate[k] for k in range(len(run))]), FINE)
    missed = np.array([lagrange(*body(k), p[k], rate[k], change[k - 2]) - force(k) for k in rows])
    if onto is not None:
        missed, change = missed @ onto, change @ onto
    return np.abs(missed).max(axis=0) / np.abs(change).max(axis=0)


def time_derivative(values: np.ndarray, period: float) -> np.ndarray:
    """d/dt of samples (N, …) by differences of fourth order, (N - 4, …): of all but the first two and last two samples."""
    return (8 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12 * period)
