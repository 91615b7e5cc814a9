"""Matrices with the same bits on every machine: products, equations, singular values and eigenvalues in a fixed order.

BLAS and LAPACK choose their kernels by the processor, and these round differently. Matrices before a run are small, up to 260
rows. Sums run over the inner index from first to last, and vector units work on neighbouring columns.
"""

import numpy as np
from numpy.typing import ArrayLike

from flexlab.compiled import compiled, inlined
from flexlab.numerics.elementary import exp, log

SAME_DIRECTION = 2e-15
"""Cosine between two rows below which they count as orthogonal: a few times what rounding leaves of a sum of a hundred."""
MOST_SWEEPS = 60
"""Most rounds of rotations: six to ten are usual."""
EPSILON = 2.0**-52
MOST_ROUNDS = 90
"""Most QR steps for one eigenvalue: two or three are usual."""
LN_2 = 0.6931471805599453
SQUARINGS = 16
"""Squarings for the largest eigenvalue: constants of the powers then count for 1e-4."""
STUCK = 10
"""Rounds after which an exceptional shift is used once."""


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
    """A B of matrices (..., m, k) and (..., k, n), or of a vector in place of either, as `A @ B`."""
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
    """X (n, k) or (n,) of A X = B, A (n, n), by elimination with pivots. Raises `NoSolution`."""
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

    By one-sided Jacobi rotations, which find small singular values to relative accuracy (Demmel and Veselić, SIAM J. Matrix
    Anal. Appl. 13(4), 1992, 1204).
    """
    rows, W = np.array(A.T, dtype=float, order="C"), np.eye(A.shape[1])
    orthogonalise(rows, W)
    sigma = np.sqrt(np.array([product(row, row) for row in rows]))
    order = np.argsort(sigma, kind="stable")
    return sigma[order], np.ascontiguousarray(W[order].T)


def eigenvalues(A: np.ndarray) -> np.ndarray:
    """Eigenvalues of A (n, n), (n,) complex, conjugates exactly so. Raises `NoSolution`."""
    H, n = balanced(A)[0], len(A)
    real, imaginary = np.empty(n), np.empty(n)
    if francis(H, real, imaginary, np.empty((2, n))) != 0:
        raise NoSolution("the eigenvalues are not found")
    return real + 1j * imaginary


def eigenvector(A: np.ndarray, value: complex) -> np.ndarray:
    """The right eigenvector (n,), complex, of length 1, of A (n, n) for one of its `eigenvalues`: by inverse iteration."""
    n = len(A)
    # A little off the eigenvalue, so that the equations have a solution.
    near = value * (1 + 1e-10) if value != 0 else complex(1e-10 * np.abs(A).max(initial=1e-300))
    shifted, turn = A - near.real * np.eye(n), near.imag * np.eye(n)
    whole = np.block([[shifted, turn], [-turn, shifted]])
    x = 1.0 / np.arange(1.0, 2 * n + 1)
    for _ in range(2):
        x = solve(whole, x)
        x = x / np.abs(x).max()
        x = x / np.sqrt(product(x, x))
    return x[:n] + 1j * x[n:]


def power_sizes(A: np.ndarray, doublings: int) -> tuple[float, float]:
    """ln ‖Aᵏ‖ of A (n, n) for k = 2ᵈ/2 and 2ᵈ with d ≥ 1 doublings. Their difference over 2ᵈ/2 is the ln of its growth."""
    sizes, twos = [0.0, 0.0], 0
    for k in range(doublings):
        A = product(A, A)
        exponent = int(np.frexp(np.abs(A).max())[1])
        A, twos = np.ldexp(A, -exponent), 2 * twos + exponent
        if k >= doublings - 2:
            sizes.append(log(float(np.sqrt(np.square(A).sum()))) + twos * LN_2)
    return sizes[-2], sizes[-1]


def spectral_radius(A: np.ndarray) -> float:
    """The largest |eigenvalue| of A (n, n), to a relative accuracy of 1e-4: from a power of it."""
    norm = float(np.abs(A).max(initial=0.0))
    if norm == 0:
        return 0.0
    half, size = power_sizes(A / norm, SQUARINGS)
    return norm * exp((size - half) / 2.0 ** (SQUARINGS - 1))


def balanced(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """S⁻¹ A S (n, n) with rows and columns of equal size, and S's diagonal (n,), powers of two, so that nothing is rounded."""
    A, scale = np.array(A, dtype=float, order="C"), np.ones(len(A))
    for _ in range(MOST_SWEEPS):
        done = True
        for k in range(len(A)):
            own = abs(A[k, k])
            column, row = float(np.abs(A[:, k]).sum() - own), float(np.abs(A[k]).sum() - own)
            if column <= 0 or row <= 0:
                continue
            factor = 2.0 ** ((np.frexp(row)[1] - np.frexp(column)[1]) // 2)
            if column * factor + row / factor < 0.95 * (column + row):
                done, scale[k] = False, scale[k] * factor
                A[:, k] *= factor
                A[k] /= factor
        if done:
            break
    return A, scale


@compiled
def multiply(A, B, C):
    """C = A B of stacks (s, m, k), (s, k, n) and (s, m, n). Sums take four terms at a time, in their order."""
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


@compiled
def francis(H, real, imaginary, scratch):
    """Eigenvalues of H (n, n), which is overwritten: Householder's and Francis's steps, as EISPACK's `orthes` and `hqr`.

    scratch (2, n). Returns 0, or 1 if they are not found.
    """
    n, v, w = len(H), scratch[0], scratch[1]
    for m in range(1, n - 1):
        scale = h = 0.0
        for i in range(m, n):
            scale += abs(H[i, m - 1])
        if scale == 0:
            continue
        for i in range(m, n):
            v[i] = H[i, m - 1] / scale
            h += v[i] * v[i]
        g = -np.sqrt(h) if v[m] > 0 else np.sqrt(h)
        h -= v[m] * g
        v[m] -= g
        for j in range(n):
            w[j] = 0.0
        for i in range(m, n):
            for j in range(n):
                w[j] += v[i] * H[i, j]
        for i in range(m, n):
            factor = v[i] / h
            for j in range(n):
                H[i, j] -= factor * w[j]
        for i in range(n):
            factor = 0.0
            for j in range(m, n):
                factor += H[i, j] * v[j]
            factor /= h
            for j in range(m, n):
                H[i, j] -= factor * v[j]
        for i in range(m + 1, n):
            H[i, m - 1] = 0.0
    last, shift, rounds, norm = n - 1, 0.0, 0, 0.0
    for i in range(n):
        for j in range(max(i - 1, 0), n):
            norm += abs(H[i, j])
    p = q = r = 0.0
    while last >= 0:
        low = last
        while low > 0:
            s = abs(H[low - 1, low - 1]) + abs(H[low, low])
            if abs(H[low, low - 1]) <= EPSILON * (s if s > 0 else norm):
                break
            low -= 1
        x = H[last, last]
        if low == last:
            real[last], imaginary[last] = x + shift, 0.0
            last, rounds = last - 1, 0
            continue
        y, product_ = H[last - 1, last - 1], H[last, last - 1] * H[last - 1, last]
        if low == last - 1:
            p = (y - x) / 2
            q = p * p + product_
            z = np.sqrt(abs(q))
            if q >= 0:
                z = p + z if p >= 0 else p - z
                real[last - 1] = x + shift + z
                real[last] = x + shift - product_ / z if z != 0 else real[last - 1]
                imaginary[last - 1] = imaginary[last] = 0.0
            else:
                real[last - 1] = real[last] = x + shift + p
                imaginary[last - 1], imaginary[last] = z, -z
            last, rounds = last - 2, 0
            continue
        if rounds == MOST_ROUNDS or not x == x:
            return 1
        rounds += 1
        if rounds % STUCK == 0:
            shift += x
            for i in range(last + 1):
                H[i, i] -= x
            s = abs(H[last, last - 1]) + abs(H[last - 1, last - 2])
            x = y = 0.75 * s
            product_ = -0.4375 * s * s
        m = last - 2
        while True:
            z = H[m, m]
            r, s = x - z, y - z
            p = (r * s - product_) / H[m + 1, m] + H[m, m + 1]
            q = H[m + 1, m + 1] - z - r - s
            r = H[m + 2, m + 1]
            s = abs(p) + abs(q) + abs(r)
            p, q, r = p / s, q / s, r / s
            if m == low:
                break
            around = abs(H[m - 1, m - 1]) + abs(z) + abs(H[m + 1, m + 1])
            if abs(H[m, m - 1]) * (abs(q) + abs(r)) <= EPSILON * abs(p) * around:
                break
            m -= 1
        for i in range(m + 2, last + 1):
            H[i, i - 2] = 0.0
            if i > m + 2:
                H[i, i - 3] = 0.0
        for k in range(m, last):
            wide = k != last - 1
            x = 1.0
            if k != m:
                p, q, r = H[k, k - 1], H[k + 1, k - 1], (H[k + 2, k - 1] if wide else 0.0)
                x = abs(p) + abs(q) + abs(r)
                if x == 0:
                    continue
                p, q, r = p / x, q / x, r / x
            s = np.sqrt(p * p + q * q + r * r)
            s = -s if p < 0 else s
            if k != m:
                H[k, k - 1] = -s * x
            elif low != m:
                H[k, k - 1] = -H[k, k - 1]
            p += s
            x, y, z = p / s, q / s, r / s
            q, r = q / p, r / p
            for j in range(k, last + 1):
                p = H[k, j] + q * H[k + 1, j]
                if wide:
                    p += r * H[k + 2, j]
                    H[k + 2, j] -= p * z
                H[k, j] -= p * x
                H[k + 1, j] -= p * y
            for i in range(low, min(last, k + 3) + 1):
                p = x * H[i, k] + y * H[i, k + 1]
                if wide:
                    p += z * H[i, k + 2]
                    H[i, k + 2] -= p * r
                H[i, k] -= p
                H[i, k + 1] -= p * q
    return 0
