"""The flexible payload: Hermite finite elements, boundaries, damping and modes (model of Eqs. 1-10).

Nodal coordinates q are (deflection, slope) per node, left to right, in the frame of the virtual link; those that the
boundary holds at zero are left out.
"""

from functools import cache, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from flexlab.boundaries import held_coordinates

GAUSS_POINTS = 4
"""Exact for polynomials up to degree 7; the mass integrand has degree 6."""

KNOWN_INERTIAS = 8
"""Meshes and densities whose inertia integrals are kept: a drag of the stiffness asks for the same ones again and again."""

COUPLING_TOLERANCE = 1e-9
"""Modal damping couplings below this fraction of their diagonal are rounding of the eigenvectors, not physics."""


class BeamMatrices(NamedTuple):
    """Finite-element integrals of a payload; n_q nodal coordinates."""

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
    B: np.ndarray
    """Curvature rows with K_F = BᵀB, (2n, n_q): their singular values give frequencies without squaring the condition."""


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
    """Cubic Hermite functions on an element of `length` at local coordinates xi in [0, 1] (Eq. 4), (4,) or (4, N)."""
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


@cache
def gauss_rule(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points in [-1, 1] and weights of Gauss quadrature, (count,) each, read-only: an eigenproblem to find."""
    points, weights = np.polynomial.legendre.leggauss(count)
    points.flags.writeable = weights.flags.writeable = False
    return points, weights


def shape_row(s: float, length: float, element_count: int, boundary: str, derivative: int = 0) -> np.ndarray:
    """N(s), or its second derivative, over the free coordinates, (n_q,); s in [-L/2, L/2]."""
    l = length / element_count  # noqa: E741
    element = min(max(int((s + length / 2) / l), 0), element_count - 1)
    xi = (s + length / 2) / l - element
    row = np.zeros(2 * (element_count + 1))
    row[2 * element : 2 * element + 4] = (shape_functions if derivative == 0 else curvature_functions)(xi, l)
    return row[free_coordinates(element_count, boundary)]


def beam_matrices(length: float, rho: float, EI: float, element_count: int, boundary: str) -> BeamMatrices:
    """Assemble the finite-element integrals (Eqs. 5, 6) for n equal elements, exactly, by Gauss quadrature."""
    M_q, h, g = _inertia(length, rho, element_count, boundary)
    B = _curvature_rows(length, EI, element_count)[:, free_coordinates(element_count, boundary)]
    return BeamMatrices(rho * length, rho * length * length * length / 12, M_q.copy(), B.T @ B, h.copy(), g.copy(), B)


@lru_cache(KNOWN_INERTIAS)
def _inertia(length: float, rho: float, element_count: int, boundary: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M_q, h and g, to be copied."""
    n = element_count
    l = length / n  # noqa: E741
    points, weights = gauss_rule(GAUSS_POINTS)
    xi, weights = (points + 1) / 2, rho * weights * l / 2
    N = np.array([shape_functions(x, l) for x in xi])
    M_element, h_element, first_moment = (N.T * weights) @ N, weights @ N, (weights * xi * l) @ N
    M = np.zeros((2 * n + 2, 2 * n + 2))
    h, g = np.zeros(2 * n + 2), np.zeros(2 * n + 2)
    for element in range(n):
        own = slice(2 * element, 2 * element + 4)
        M[own, own] += M_element
        h[own] += h_element
        g[own] += first_moment + (element * l - length / 2) * h_element
    free = free_coordinates(n, boundary)
    return M[np.ix_(free, free)], h[free], g[free]


def _curvature_rows(length: float, EI: float, n: int) -> np.ndarray:
    """sqrt(EI weight) N'' at the two Gauss points of each element, (2n, 2n + 2): exact, as N'' is linear."""
    l = length / n  # noqa: E741
    points, weights = gauss_rule(2)
    element_rows = np.array([curvature_functions((x + 1) / 2, l) for x in points])
    element_rows *= np.sqrt(EI * weights * l / 2)[:, None]
    rows = np.zeros((2 * n, 2 * n + 2))
    for element in range(n):
        rows[2 * element : 2 * element + 2, 2 * element : 2 * element + 4] = element_rows
    return rows


def undamped_modes(beam: BeamMatrices) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies ω (n_q,), ascending, and mass-normalised shapes V (n_q, n_q) of K_F v = ω² M_q v.

    ω are the singular values of B R⁻¹ with M_q = RᵀR: relative accuracy ε ω_max/ω instead of the ε (ω_max/ω)² that
    a generalised eigensolver gives, which matters for the lowest modes of fine meshes.
    """
    # Deflections and slopes differ by an element length: a unit diagonal conditions M for every mesh.
    scale = 1 / np.sqrt(np.diag(beam.M_q))
    R = cholesky(beam.M_q * np.outer(scale, scale))
    BR = solve_triangular(R, (beam.B * scale).T, trans="T").T
    _, sigma, W = np.linalg.svd(BR)
    V = scale[:, None] * solve_triangular(R, W[::-1].T)
    # One sign for ever: the leftmost coordinate that moves notably goes up.
    for column in V.T:
        lead = np.flatnonzero(np.abs(column / scale) > 0.1 * np.max(np.abs(column / scale)))[0]
        column *= np.sign(column[lead])
    return sigma[::-1].copy(), V


def _first_connected(coupled: np.ndarray) -> np.ndarray:
    """For each index the lowest one that it is connected with, directly or through others, (n,); coupled: (n, n)."""
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
