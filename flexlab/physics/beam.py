"""The flexible payload: Hermite finite elements, boundaries, damping and modes.

The point of the beam at s stands at (x0, y0) + s e1 + w(s) e2 (Eq. (1)), e1 and e2 being the axes of the virtual link; its
deflection is w = N q (Eq. (3)).

Nodal coordinates q are (deflection, slope) per node, left to right, in the frame of the virtual link; those that the
boundary holds at zero are left out.
"""

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np

from flexlab.boundaries import held_coordinates
from flexlab.compiled import inlined
from flexlab.numerics.elementary import sin_cos
from flexlab.numerics.linear_algebra import cholesky, product, singular_vectors, solve


@inlined
def quasi_static_deflection(compliance, gravity, desired):
    """w_qs = -N(0) K_F⁻¹ [h (e2_d·a_d + g cos θ_d) + g θ̈_d], m: static deflection under desired motion and weight.

    `desired`: x_d, ẋ_d, ẍ_d (3, 3); `compliance` as in `Plant`. The actual acceleration would not do: it jumps when a motion
    starts or a hand taps, and the jump would count as vibration.
    """
    s, c = sin_cos(desired[0, 2])
    lateral = c * desired[2, 1] - s * desired[2, 0] + gravity * c
    return compliance[0] * lateral + compliance[1] * desired[2, 2]


GAUSS_POINTS = 4
"""Gauss points per element: exact for polynomials up to degree 7; the mass integrand has degree 6."""
KNOWN_MESHES = 8
"""Number of meshes whose integrals and modes are kept: stiffness, density and length only scale them."""
COUPLING_TOLERANCE = 1e-9
"""Modal damping couplings below this fraction of their diagonal are rounding of the eigenvectors, not physics."""


class BeamMatrices(NamedTuple):
    """Finite-element integrals of a payload, of which Eqs. (9) and (10) are made; n_q nodal coordinates."""

    m: float
    """ρL, kg."""
    I: float  # noqa: E741  (the symbol of the model)
    """ρL³/12, kg·m²."""
    M_q: np.ndarray
    """ρ∫NᵀN ds, (n_q, n_q)."""
    K_F: np.ndarray
    """EI∫N''ᵀN'' ds, (n_q, n_q)."""
    h: np.ndarray
    """ρ∫Nᵀds, (n_q,)."""
    g: np.ndarray
    """ρ∫sNᵀds, (n_q,)."""
    mesh: tuple[int, str]
    """Elements, and boundary."""
    unit_omega: float
    """√(EI/ρl⁴) of elements of length l, rad/s: ω of a mode over that of the same mesh with EI = ρ = l = 1."""
    unit_shapes: np.ndarray
    """Entries of a mass-normalised shape over those of that mesh, (n_q,)."""

    def with_mass(self, factor: float) -> "BeamMatrices":
        """A copy with the integrals that are proportional to ρ times a factor, 1; those of the mesh and its modes stay."""
        m, I, M_q, h, g = (factor * value for value in (self.m, self.I, self.M_q, self.h, self.g))  # noqa: E741
        return self._replace(m=m, I=I, M_q=M_q, h=h, g=g)


class BeamModes(NamedTuple):
    """Undamped modes of the beam with its grips held, n_m of them, grouped in blocks that damping couples."""

    omega: np.ndarray
    """ω, rad/s, (n_m,)."""
    V: np.ndarray
    """Mass-normalised shapes, VᵀM_qV = 1, (n_q, n_m)."""
    D: np.ndarray
    """VᵀDV, modal damping matrix, 1/s, (n_m, n_m), block diagonal."""
    block_start: np.ndarray
    """Blocks of coupled modes: block b holds modes block_start[b] up to block_start[b + 1]."""


def shape_functions(xi: float | np.ndarray, length: float) -> np.ndarray:
    """Cubic Hermite functions on an element of `length` at local coordinates xi in [0, 1] (Eq. (4)), (4,) or (4, N)."""
    return np.array(
        [
            1 - xi * xi * (3 - 2 * xi),
            length * xi * (1 - xi) * (1 - xi),
            xi * xi * (3 - 2 * xi),
            length * xi * xi * (xi - 1),
        ]
    )


def curvature_functions(xi: float, length: float) -> np.ndarray:
    """Second derivatives with respect to s of `shape_functions`, 1/m² and 1/m, (4,)."""
    return np.array([12 * xi - 6, length * (6 * xi - 4), 6 - 12 * xi, length * (6 * xi - 2)]) / (length * length)


@cache
def free_coordinates(element_count: int, boundary: str) -> np.ndarray:
    """Indices into the 2 (n + 1) nodal coordinates that the boundary leaves free (read-only)."""
    free = np.setdiff1d(np.arange(2 * element_count + 2), held_coordinates(element_count, boundary))
    free.flags.writeable = False
    return free


def gauss_rule(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points in [-1, 1] and weights of Gauss quadrature with 2 or 4 points, (count,) each."""
    if count == 2:
        point = np.sqrt(1 / 3)
        return np.array([-point, point]), np.ones(2)
    spread, share = 2 / 7 * np.sqrt(6 / 5), np.sqrt(30.0) / 36
    near, far = np.sqrt(3 / 7 - spread), np.sqrt(3 / 7 + spread)
    return np.array([-far, -near, near, far]), np.array([0.5 - share, 0.5 + share, 0.5 + share, 0.5 - share])


def shape_row(s: float, length: float, element_count: int, boundary: str, derivative: int = 0) -> np.ndarray:
    """N(s), or its second derivative, over the free coordinates, (n_q,); s in [-L/2, L/2]."""
    l = length / element_count  # noqa: E741
    element = min(max(int((s + length / 2) / l), 0), element_count - 1)
    xi = (s + length / 2) / l - element
    row = np.zeros(2 * (element_count + 1))
    row[2 * element : 2 * element + 4] = (shape_functions if derivative == 0 else curvature_functions)(xi, l)
    return row[free_coordinates(element_count, boundary)]


def beam_matrices(length: float, rho: float, EI: float, element_count: int, boundary: str) -> BeamMatrices:
    """Assemble the finite-element integrals (Eqs. (5), (6)) for n equal elements, exactly, by Gauss quadrature."""
    unit, l = _unit_integrals(element_count, boundary), length / element_count  # noqa: E741
    mass, stiffness = rho * l, EI / (l * l * l)
    lengths = np.where(free_coordinates(element_count, boundary) % 2 == 1, l, 1.0)  # The unit mesh has slopes per l.
    both = lengths[:, None] * lengths
    return BeamMatrices(
        m=rho * length,
        I=rho * (length * length * length) / 12,
        M_q=mass * (unit.M * both),
        K_F=stiffness * (unit.K * both),
        h=mass * (unit.h * lengths),
        g=mass * l * (unit.g * lengths),
        mesh=(element_count, boundary),
        unit_omega=float(np.sqrt(EI / rho)) / (l * l),
        unit_shapes=1 / (lengths * np.sqrt(mass)),
    )


class _UnitIntegrals(NamedTuple):
    """Integrals of a mesh with EI = ρ = l = 1, and its curvature rows B with K = BᵀB, (2n, n_q)."""

    M: np.ndarray
    K: np.ndarray
    h: np.ndarray
    g: np.ndarray
    B: np.ndarray


@lru_cache(KNOWN_MESHES)
def _unit_integrals(n: int, boundary: str) -> _UnitIntegrals:
    points, weights = gauss_rule(GAUSS_POINTS)
    xi, weights = (points + 1) / 2, weights / 2
    N = shape_functions(xi, 1.0).T
    M_element, h_element, first_moment = product(N.T * weights, N), product(weights, N), product(weights * xi, N)
    # Two points are exact for products of curvatures, which are linear.
    bends = np.array([curvature_functions((x + 1) / 2, 1.0) for x in gauss_rule(2)[0]]) * np.sqrt(0.5)
    K_element = product(bends.T, bends)
    M, K, B = np.zeros((2 * n + 2, 2 * n + 2)), np.zeros((2 * n + 2, 2 * n + 2)), np.zeros((2 * n, 2 * n + 2))
    h, g = np.zeros(2 * n + 2), np.zeros(2 * n + 2)
    for element in range(n):
        own = slice(2 * element, 2 * element + 4)
        M[own, own] += M_element
        K[own, own] += K_element
        B[2 * element : 2 * element + 2, own] = bends
        h[own] += h_element
        g[own] += first_moment + (element - n / 2) * h_element
    free = free_coordinates(n, boundary)
    return _UnitIntegrals(M[np.ix_(free, free)], K[np.ix_(free, free)], h[free], g[free], B[:, free])


def undamped_modes(beam: BeamMatrices) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies ω (n_q,), ascending, and mass-normalised shapes V (n_q, n_q) of K_F v = ω² M_q v."""
    omega, V = _unit_modes(*beam.mesh)
    return beam.unit_omega * omega, beam.unit_shapes[:, None] * V


@lru_cache(KNOWN_MESHES)
def _unit_modes(element_count: int, boundary: str) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and shapes of a mesh with EI = ρ = l = 1.

    ω are the singular values of B R⁻¹ with M = RᵀR: relative accuracy ε ω_max/ω instead of the ε (ω_max/ω)² that
    a generalised eigensolver gives, which matters for the lowest modes of fine meshes.
    """
    unit = _unit_integrals(element_count, boundary)
    R = cholesky(unit.M)
    omega, W = singular_vectors(solve(R.T, unit.B.T).T)
    V = solve(R, W)
    # The sign is fixed so that the leftmost notable coordinate is positive.
    notable = np.abs(V) > 0.1 * np.abs(V).max(axis=0)
    return omega, V * np.sign(V[np.argmax(notable, axis=0), np.arange(V.shape[1])])


def _first_connected(coupled: np.ndarray) -> np.ndarray:
    """The lowest index with which each is connected, directly or through others, (n,); coupled: (n, n)."""
    neighbours, first = coupled | coupled.T | np.eye(len(coupled), dtype=bool), np.arange(len(coupled))
    while True:
        lower = np.where(neighbours, first, len(first)).min(axis=1, initial=len(first))
        if np.array_equal(lower, first):
            return first
        first = lower


def beam_modes(omega: np.ndarray, V: np.ndarray, damping: np.ndarray) -> BeamModes:
    """Group modes into blocks that modal `damping` VᵀDV (n_m, n_m) couples and reorder them block by block.

    Nodal damping couples the modes of one symmetry (two blocks; one where the ends differ); stiffness and modal damping
    couple none, so that the cost of a step is linear in n.
    """
    weight = np.sqrt(np.maximum(np.diag(damping), np.finfo(float).tiny))
    coupled = np.abs(damping) > COUPLING_TOLERANCE * np.outer(weight, weight)
    first = _first_connected(coupled)
    order = np.argsort(first, kind="stable")
    starts = np.concatenate([[0], np.flatnonzero(np.diff(first[order])) + 1, [len(order)]]).astype(np.int64)
    return BeamModes(omega[order], np.ascontiguousarray(V[:, order]), damping[np.ix_(order, order)], starts)
