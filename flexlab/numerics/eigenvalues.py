"""Eigenvalues with the same bits on every machine, by operations in a fixed order."""

import numpy as np

from flexlab.compiled import compiled
from flexlab.numerics.elementary import exp, log
from flexlab.numerics.linear_algebra import MOST_SWEEPS, NoSolution, product, solve

EPSILON = 2.0**-52
MOST_ROUNDS = 90
"""Largest number of QR steps for one eigenvalue; two or three are usual."""
STUCK = 10
"""An exceptional shift is made after every so many QR steps for one eigenvalue."""
LN_2 = 0.6931471805599453
SQUARINGS = 16
"""Squarings of a matrix for its spectral radius: enough for a relative accuracy of 1e-4."""


def eigenvalues(A: np.ndarray) -> np.ndarray:
    """Return the complex eigenvalues (n,) of A (n, n); conjugate pairs are exactly conjugate. Raises `NoSolution`."""
    H, n = balanced(A)[0], len(A)
    real, imaginary = np.empty(n), np.empty(n)
    if francis(H, real, imaginary, np.empty((2, n))) != 0:
        raise NoSolution("the eigenvalues are not found")
    return real + 1j * imaginary


def eigenvector(A: np.ndarray, value: complex) -> np.ndarray:
    """Return the complex right eigenvector (n,), of length 1, of A (n, n) for one of its `eigenvalues`, by inverse iteration."""
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
    """Return ln ‖Aᵏ‖ of A (n, n) for k = 2ᵈ/2 and 2ᵈ, d ≥ 1 doublings; the difference over 2ᵈ/2 is ln of the growth factor."""
    sizes, twos = [0.0, 0.0], 0
    for k in range(doublings):
        A = product(A, A)
        exponent = int(np.frexp(np.abs(A).max())[1])
        A, twos = np.ldexp(A, -exponent), 2 * twos + exponent
        if k >= doublings - 2:
            sizes.append(log(float(np.sqrt(np.square(A).sum()))) + twos * LN_2)
    return sizes[-2], sizes[-1]


def spectral_radius(A: np.ndarray) -> float:
    """Return the largest |eigenvalue| of A (n, n) from a power of A, to a relative accuracy of 1e-4."""
    norm = float(np.abs(A).max(initial=0.0))
    if norm == 0:
        return 0.0
    half, size = power_sizes(A / norm, SQUARINGS)
    return norm * exp((size - half) / 2.0 ** (SQUARINGS - 1))


def balanced(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return S⁻¹ A S (n, n), with rows and columns of similar size, and the diagonal of S (n,): powers of two, so it is exact."""
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
def francis(H, real, imaginary, scratch):
    """Find the eigenvalues of H (n, n), which is overwritten, by Householder and Francis steps as EISPACK's `orthes` and `hqr`.

    Fills `real` and `imaginary` (n,); scratch (2, n). Returns 0, or 1 if the eigenvalues are not found.
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
