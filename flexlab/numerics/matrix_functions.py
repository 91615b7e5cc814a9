"""Exponential and φ functions of matrices, and Riccati equations, with the same bits on every machine."""

import math
from functools import cache

import numpy as np

from flexlab.numerics.eigenvalues import balanced
from flexlab.numerics.linear_algebra import NoSolution, inverse, product, solve

TAYLOR_NORM, TAYLOR_TERMS = 2.0, 22
"""Largest norm, and number of terms, for Taylor series of exponential and φ functions to double precision."""
MOST_DOUBLINGS = 60
"""Largest number of doublings of a Riccati equation's horizon; eight to twenty are usual."""
NEWTON_STEPS = 2
"""Newton steps after the doublings; each squares the remaining error."""
CONVERGED = 1e-15
"""Relative change of a solution in one doubling at which it counts as converged."""
Functions = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def phi_functions(z: np.ndarray) -> list[Functions]:
    """Return φ0 = exp, φ1, φ2, φ3 of square matrices z (..., k, k), then those of z/2, z/4, … found on the way.

    Uses Taylor series and doubling: φ_k(z) = Σ_j z^j/(j + k)!;  φ_k(2z) = 2^-k (φ0 φ_k + Σ_{j=1..k} φ_j/(k - j)!).
    """
    halves = doublings_to(float(np.max(np.abs(z).sum(axis=-1), initial=0.0)), TAYLOR_NORM)
    z = z / 2.0**halves
    one = np.broadcast_to(np.eye(z.shape[-1]), z.shape)
    phi3 = one / _factorial(TAYLOR_TERMS + 3)
    for j in range(TAYLOR_TERMS - 1, -1, -1):
        phi3 = product(z, phi3) + one / _factorial(j + 3)
    phi2 = product(z, phi3) + one / 2
    phi1 = product(z, phi2) + one
    phi0 = product(z, phi1) + one
    found = [(phi0, phi1, phi2, phi3)]
    for _ in range(halves):
        found.append(doubled(*found[-1]))
    return found[::-1]


def doubled(phi0: np.ndarray, phi1: np.ndarray, phi2: np.ndarray, phi3: np.ndarray) -> Functions:
    """φ0, φ1, φ2, φ3 of 2z from those of z."""
    k = phi0.shape[-1]
    times = product(phi0, np.concatenate([phi0, phi1, phi2, phi3], axis=-1))
    whole, first, second, third = (times[..., j * k : (j + 1) * k] for j in range(4))
    return (
        np.ascontiguousarray(whole),
        (first + phi1) / 2,
        (second + phi1 + phi2) / 4,
        (third + phi1 / 2 + phi2 + phi3) / 8,
    )


def doublings_to(value: float, unit: float) -> int:
    """The smallest whole k ≥ 0 with unit · 2ᵏ ≥ value."""
    mantissa, exponent = math.frexp(value / unit)
    return max(0, exponent - (mantissa == 0.5))


@cache
def _factorial(k: int) -> float:
    return float(np.prod(np.arange(1, k + 1, dtype=float)))


def exponential(A: np.ndarray) -> np.ndarray:
    """Return exp A of a matrix (n, n), by Taylor series and doubling after balancing. Raises `NoSolution`."""
    even, scale = balanced(A)
    if not np.isfinite(even).all():
        raise NoSolution("the matrix is not finite")
    halves = doublings_to(float(np.max(np.abs(even).sum(axis=-1), initial=0.0)), TAYLOR_NORM)
    z = even / 2.0**halves
    # E = e^z - 1 keeps the digits of slow parts beside fast ones; it doubles by (1 + E)² - 1 = 2 E + E².
    E = np.zeros_like(z)
    for j in range(TAYLOR_TERMS, 0, -1):
        E = product(z / j, E + np.eye(len(z)))
    for _ in range(halves):
        E = 2 * E + product(E, E)
    return (E + np.eye(len(z))) * scale[:, None] / scale


def discrete_riccati(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return the stabilising solution P (n, n) of P = AᵀPA - AᵀPB (R + BᵀPB)⁻¹BᵀPA + Q. Raises `NoSolution`.

    Doubles the horizon (SDA: Chu, Fan, Lin, Wang, Int. J. Control 77(8), 2004, 767), which loses digits if the weights differ
    widely, and restores them by Newton steps. Shapes: A, Q (n, n), B (n, m), R (m, m).
    """
    G, H = product(product(B, inverse(R)), B.T), np.array(Q, dtype=float)
    # Scale the states to one size, by powers of two.
    scale = _state_scale(G, H)
    A, B, Q, G, H = (
        A / scale[:, None] * scale,
        B / scale[:, None],
        Q * scale[:, None] * scale,
        G / scale[:, None] / scale,
        H * scale[:, None] * scale,
    )
    P = _doubled_horizon(A, G, H)
    for _ in range(NEWTON_STEPS):
        pushed = product(B.T, P)
        K = solve(R + product(pushed, B), product(pushed, A))
        closed = A - product(B, K)
        change = product(product(A.T, P), closed) + Q - P
        P = P + _sum_of_powers(closed, (change + change.T) / 2)
    return P / scale[:, None] / scale


def _doubled_horizon(A: np.ndarray, G: np.ndarray, H: np.ndarray) -> np.ndarray:
    """Solve P = Aᵀ P (1 + G P)⁻¹ A + H for P; all are (n, n)."""
    n, one = len(A), np.eye(len(A))
    for _ in range(MOST_DOUBLINGS):
        both = solve(one + product(G, H), np.concatenate([A, G], axis=1))
        over, through = both[:, :n], both[:, n:]
        gain = product(product(over.T, H), A)
        more = product(product(A, through), A.T)
        A, G, H = product(A, over), G + (more + more.T) / 2, H + (gain + gain.T) / 2
        size = np.abs(H).max()
        if not np.isfinite(size):
            break
        if np.abs(gain).max() <= CONVERGED * size:
            return H
    raise NoSolution("the Riccati equation has no stabilising solution")


def _sum_of_powers(F: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return Σ (Fᵀ)ᵏ X Fᵏ over all k ≥ 0 for a stable F (n, n) and a symmetric X. Raises `NoSolution` for an unstable F."""
    for _ in range(MOST_DOUBLINGS):
        more = product(product(F.T, X), F)
        X, F = X + (more + more.T) / 2, product(F, F)
        if np.abs(more).max() <= CONVERGED * np.abs(X).max():
            return X
        if not np.isfinite(X).all():
            break
    raise NoSolution("the closed loop is not stable")


def _state_scale(G: np.ndarray, H: np.ndarray) -> np.ndarray:
    """Powers of two (n,) that bring the diagonal entries of G and H for each state to one size."""
    g, h = np.diag(G), np.diag(H)
    known = (g > 0) & (h > 0)
    exponents = np.where(known, (np.frexp(np.where(known, g, 1.0))[1] - np.frexp(np.where(known, h, 1.0))[1]) // 4, 0)
    return 2.0**exponents
