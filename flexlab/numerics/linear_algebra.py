"""Matrices with the same bits on every machine: products, equations and singular values in a fixed order.

BLAS and LAPACK choose kernels by the processor, and these round differently. Matrices needed before a run are small: up to 260
rows. Sums run over the inner index from first to last, and vector units work on neighbouring columns.
"""

import numpy as np
from numpy.typing import ArrayLike

from flexlab.compiled import compiled, inlined

SAME_DIRECTION = 2e-15
"""Cosine between two rows below which they count as orthogonal: a few times the rounding error of a sum of a hundred terms."""
MOST_SWEEPS = 60
"""Largest number of rounds of rotations; six to ten are usual."""


class NoSolution(ValueError):
    """Raised for matrices without a solution."""


@inlined
def solve_symmetric(S, b):
    """Solve S z = b in place of b for a symmetric positive definite 3 x 3 matrix (LDLᵀ)."""
    d0 = S[0, 0]
    l10, l20 = S[1, 0] / d0, S[2, 0] / d0
    d1 = S[1, 1] - l10 * S[1, 0]
    l21 = (S[2, 1] - l20 * S[1, 0]) / d1
    d2 = S[2, 2] - l20 * S[2, 0] - l21 * l21 * d1
    z1 = b[1] - l10 * b[0]
    z2 = (b[2] - l20 * b[0] - l21 * z1) / d2
    b[2] = z2
    b[1] = z1 / d1 - l21 * z2
    b[0] = b[0] / d0 - l10 * b[1] - l20 * z2


def product(A: ArrayLike, B: ArrayLike) -> np.ndarray:
    """Return A B for matrices (..., m, k) and (..., k, n), or a vector in place of either, as `A @ B` does."""
    left, right = np.ascontiguousarray(A, dtype=float), np.ascontiguousarray(B, dtype=float)
    if left.ndim == 1:
        return product(left[None], right)[..., 0, :] if right.ndim > 1 else product(left[None], right)[0]
    if right.ndim == 1:
        return product(left, right[:, None])[..., 0]
    if left.ndim == right.ndim == 2:
        found = np.empty((1, len(left), right.shape[1]))
        multiply(left[None], right[None], found)
        return found[0]
    shape = np.broadcast_shapes(left.shape[:-2], right.shape[:-2])
    left, right = _stacked(left, shape), _stacked(right, shape)
    found = np.empty((len(left), left.shape[1], right.shape[2]))
    multiply(left, right, found)
    return found.reshape(*shape, *found.shape[1:])


def _stacked(A: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Matrices (..., m, n) as one stack (k, m, n) for the leading axes `shape`."""
    whole = A if A.shape[:-2] == shape else np.ascontiguousarray(np.broadcast_to(A, (*shape, *A.shape[-2:])))
    return whole.reshape(-1, *A.shape[-2:])


def solve(A: ArrayLike, B: ArrayLike) -> np.ndarray:
    """Solve A X = B for X (n, k) or (n,), A (n, n), by Gaussian elimination with partial pivoting. Raises `NoSolution`."""
    matrix, right = np.array(A, dtype=float, order="C"), np.array(B, dtype=float, order="C")
    found = right.reshape(len(right), -1)
    if eliminate(matrix, found) != 0 or not np.isfinite(found).all():
        raise NoSolution("the matrix is singular")
    return found.reshape(right.shape)


def inverse(A: np.ndarray) -> np.ndarray:
    """A⁻¹ (n, n). Raises `NoSolution`."""
    return solve(A, np.eye(len(A)))


def cholesky(A: np.ndarray) -> np.ndarray:
    """Upper triangular R with A = RᵀR, A (n, n) symmetric and positive definite. Raises `NoSolution`."""
    rest, R = np.array(A, dtype=float), np.zeros_like(A, dtype=float)
    for k in range(len(A)):
        if not rest[k, k] > 0:
            raise NoSolution("the matrix is not positive definite")
        R[k, k:] = rest[k, k:] / np.sqrt(rest[k, k])
        rest[k + 1 :, k + 1 :] -= np.outer(R[k, k + 1 :], R[k, k + 1 :])
    return R


def singular_vectors(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values of A (m, n) with n ≤ m, (n,), ascending, and its right singular vectors as columns, (n, n).

    Uses one-sided Jacobi rotations, which find small singular values to relative accuracy (Demmel and Veselić, SIAM J. Matrix
    Anal. Appl. 13(4), 1992, 1204).
    """
    rows, W = np.array(A.T, dtype=float, order="C"), np.eye(A.shape[1])
    orthogonalise(rows, W)
    sigma = np.sqrt(np.array([product(row, row) for row in rows]))
    order = np.argsort(sigma, kind="stable")
    return sigma[order], np.ascontiguousarray(W[order].T)


@compiled
def multiply(A, B, C):
    """Fill C (s, m, n) with A B of stacks (s, m, k) and (s, k, n). Sums take four terms at a time, in order."""
    inner, columns = B.shape[1], B.shape[2]
    for stack in range(len(C)):
        for i in range(C.shape[1]):
            a, c = A[stack, i], C[stack, i]
            for j in range(columns):
                c[j] = 0.0
            k = 0
            while k + 4 <= inner:
                a0, a1, a2, a3 = a[k], a[k + 1], a[k + 2], a[k + 3]
                if a0 != 0 or a1 != 0 or a2 != 0 or a3 != 0:
                    b0, b1, b2, b3 = B[stack, k], B[stack, k + 1], B[stack, k + 2], B[stack, k + 3]
                    for j in range(columns):
                        c[j] = (((c[j] + a0 * b0[j]) + a1 * b1[j]) + a2 * b2[j]) + a3 * b3[j]
                k += 4
            while k < inner:
                a0, b0 = a[k], B[stack, k]
                for j in range(columns):
                    c[j] += a0 * b0[j]
                k += 1


@compiled
def eliminate(A, X):
    """Turn X (n, k) into A⁻¹X; A (n, n) is overwritten. Returns 0, or 1 if A is singular."""
    n = len(A)
    for k in range(n):
        at = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[at, k]):
                at = i
        if not abs(A[at, k]) > 0:
            return 1
        if at != k:
            for j in range(n):
                A[k, j], A[at, j] = A[at, j], A[k, j]
            for j in range(X.shape[1]):
                X[k, j], X[at, j] = X[at, j], X[k, j]
        for i in range(k + 1, n):
            factor = A[i, k] / A[k, k]
            if factor != 0:
                for j in range(k + 1, n):
                    A[i, j] -= factor * A[k, j]
                for j in range(X.shape[1]):
                    X[i, j] -= factor * X[k, j]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            factor = A[i, k]
            for j in range(X.shape[1]):
                X[i, j] -= factor * X[k, j]
        for j in range(X.shape[1]):
            X[i, j] /= A[i, i]
    return 0


@compiled
def orthogonalise(G, W):
    """Rotate the rows of G (n, m) among themselves until they are orthogonal, and those of W (n, k) with them."""
    for _ in range(MOST_SWEEPS):
        rotated = False
        for i in range(len(G) - 1):
            for j in range(i + 1, len(G)):
                one, other = G[i], G[j]
                a = b = c = 0.0
                for k in range(len(one)):
                    a += one[k] * one[k]
                    b += other[k] * other[k]
                    c += one[k] * other[k]
                if abs(c) <= SAME_DIRECTION * np.sqrt(a) * np.sqrt(b):
                    continue
                rotated = True
                zeta = (b - a) / (2 * c)
                t = 1 / (abs(zeta) + np.sqrt(1 + zeta * zeta))
                t = t if zeta >= 0 else -t
                cosine = 1 / np.sqrt(1 + t * t)
                sine = cosine * t
                for k in range(len(one)):
                    value = one[k]
                    one[k] = cosine * value - sine * other[k]
                    other[k] = sine * value + cosine * other[k]
                one, other = W[i], W[j]
                for k in range(len(one)):
                    value = one[k]
                    one[k] = cosine * value - sine * other[k]
                    other[k] = sine * value + cosine * other[k]
        if not rotated:
            return
