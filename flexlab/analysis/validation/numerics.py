"""Elementary functions and small matrices, which the engine computes itself, against the C library, NumPy and SciPy."""

import math
from collections.abc import Iterator

import numpy as np
from scipy.linalg import block_diag, eigh, expm

from flexlab.analysis.validation.check import Check, Runs, alike, below, close, subject, true
from flexlab.control.rates import largest_form_ratio, largest_ratio
from flexlab.numerics.eigenvalues import eigenvalues, eigenvector, spectral_radius
from flexlab.numerics.elementary import atan2, cos, each, exp, log, sin
from flexlab.numerics.linear_algebra import cholesky, inverse, product, singular_vectors, solve_symmetric
from flexlab.numerics.matrix_functions import exponential, phi_functions
from flexlab.sim.parametric_resonance import one_step

COUNT = 150
"""Arguments that are tried per range."""
LAST_PLACES = 2.5
"""Largest difference from the C library, whose own error is about 1, in units in the last place."""
WAVES = np.r_[0.7, -1.2, 3.0, 8.0, 40.0] * 1j + np.r_[0.0, -0.1, -0.5, 0.0, -30.0]
"""Upper halves of the conjugate pairs of a matrix's eigenvalues, beside which it has `DECAYS`."""
DECAYS = (-1.0, -2.5, 4.0, 0.3)


@subject("Numerical building blocks", 19)
def numerics(_: Runs) -> Iterator[Check]:
    """Elementary functions over their whole range, then eigenvalues, singular values, equations and matrix functions."""
    yield from _elementary()
    random = np.random.default_rng(4)
    yield from _eigenvalues(random)
    yield from _equations(random)
    yield from _functions_of_matrices(random)
    yield _one_step()
    S, Q, gain = (_positive(random, 3) for _ in range(2)), _positive(random, 3), np.array([3.0, 0.0, 40.0])
    for inertia in S:
        told = largest_ratio(inertia, gain, np.empty((3, 3))), largest_form_ratio(inertia, Q.copy(), np.empty((3, 3)))
        exact = [eigh(form, inertia, eigvals_only=True)[-1] for form in (np.diag(gain), Q)]
        yield alike("largest eigenvalue of a gain or a form on an inertia: relative error", 1e-13, told, exact)


def _elementary() -> Iterator[Check]:
    random = np.random.default_rng(3)
    near, wide, far = random.uniform(-4, 4, COUNT), random.uniform(-1e6, 1e6, COUNT), random.uniform(5, 300, COUNT)
    angles = np.concatenate([near, wide, random.choice([-1, 1], COUNT) * 10.0**far])
    yield _last_places("sin", each(sin, angles), [math.sin(x) for x in angles])
    yield _last_places("cos", each(cos, angles), [math.cos(x) for x in angles])
    size = 10.0 ** np.concatenate([random.uniform(-1, 1, COUNT), random.uniform(-300, 300, COUNT)])
    y, x = size * np.sin(np.resize(near, 2 * COUNT)), size * np.cos(np.resize(near, 2 * COUNT))
    told = np.array([atan2(*place) for place in zip(y.tolist(), x.tolist(), strict=True)])
    yield _last_places("atan2", told, [math.atan2(*place) for place in zip(y, x, strict=True)])
    edges = [(0.0, 0.0), (-0.0, -0.0), (0.0, -1.0), (np.inf, 1.0), (-1.0, -np.inf), (np.inf, -np.inf), (3e-310, 2e-310)]
    yield true(
        "atan2 at zero and infinity", [atan2(*place) for place in edges] == [math.atan2(*place) for place in edges]
    )
    powers = np.concatenate([near, random.uniform(-745, 709, COUNT), random.uniform(-745, -709, COUNT)])
    yield _last_places("exp", each(exp, powers), [math.exp(x) for x in powers])
    beyond = bool(np.array_equal(each(exp, [710.0, -746.0]), [np.inf, 0.0]))
    yield true("and beyond what numbers can hold, infinity or zero", beyond)
    positive = np.concatenate([size, random.uniform(0.5, 2, COUNT), random.uniform(1, 9, COUNT) * 1e-310])
    yield _last_places("ln", each(log, positive), [math.log(x) for x in positive])


def _last_places(name: str, found: np.ndarray, exact: list[float]) -> Check:
    off = (found - np.array(exact)) / [math.ulp(value) for value in exact]
    return below(f"{name} beside the C library's: difference, in units in the last place", LAST_PLACES, off)


def _positive(random: np.random.Generator, n: int) -> np.ndarray:
    """A symmetric positive definite matrix (n, n)."""
    A = random.normal(size=(n, n))
    return A @ A.T + 0.1 * np.eye(n)


def _eigenvalues(random: np.random.Generator) -> Iterator[Check]:
    """Eigenvalues that a matrix is made of, in rows of very different size, and those of a permutation, which need a shift."""
    blocks = [[[w.real, w.imag], [-w.imag, w.real]] for w in WAVES]
    V, own = random.normal(size=(14, 14)), np.array(block_diag(*blocks, np.diag(DECAYS)))
    size = 10.0 ** random.uniform(-4, 4, 14)
    A = size[:, None] * (V @ own @ np.linalg.inv(V)) / size
    made_of = np.concatenate([WAVES, WAVES.conj(), DECAYS])
    turning = np.roll(np.eye(7), 1, axis=0) + 0.3 * np.eye(7)
    for words, matrix, exact in (
        ("a matrix made of them", A, made_of),
        ("a cyclic permutation + 0.3", turning, 0.3 + np.exp(2j * np.pi * np.arange(7) / 7)),
    ):
        apart = np.abs(eigenvalues(matrix)[:, None] - exact)
        missed = max(apart.min(axis=0).max(), apart.min(axis=1).max()) / np.abs(exact).max()
        yield below(f"eigenvalues of {words}: largest distance, as a part", 1e-12, missed)
    even = A * size / size[:, None]
    vectors = np.stack([eigenvector(even, value) for value in made_of[[0, 4, -1]]])
    left = np.abs(vectors @ even.T - made_of[[0, 4, -1], None] * vectors).max()
    yield below("A v = λ v for its eigenvectors, of length 1: largest difference", 1e-11, left)
    exact = np.abs(made_of).max()
    yield below("its spectral radius: relative error", 1e-4, spectral_radius(even) / exact - 1)


def _equations(random: np.random.Generator) -> Iterator[Check]:
    A, B = random.normal(size=(2, 1, 7, 11)), random.normal(size=(3, 11, 6))
    A[:, :, 2:4, 4:8] = 0.0
    yield alike("products of stacks of matrices: relative error", 1e-14, product(A, B), A @ B)
    A = random.normal(size=(7, 7))
    A[0, 0] = 0.0
    yield alike("inverse, where a pivot is zero: relative error", 1e-12, inverse(A), np.linalg.inv(A))
    S, b = _positive(random, 3), random.normal(size=3)
    told = b.copy()
    solve_symmetric(S, told)
    yield alike("three symmetric equations: relative error", 1e-12, told, np.linalg.solve(S, b))
    S = _positive(random, 6)
    yield alike("Cholesky's factor: relative error", 1e-13, cholesky(S), np.linalg.cholesky(S).T)
    A = random.normal(size=(9, 6)) * 10.0 ** np.arange(0, -12, -2)
    sigma, W = singular_vectors(A)
    # Columns that differ so much in size keep their singular values to relative accuracy, unlike with LAPACK's usual ones.
    U = A @ W / sigma
    yield below("singular vectors: UᵀU = 1 and WᵀW = 1", 1e-12, np.stack([U.T @ U - np.eye(6), W.T @ W - np.eye(6)]))
    yield alike("singular values: the largest, relative error", 1e-13, sigma[-1], np.linalg.svd(A, compute_uv=False)[0])


def _functions_of_matrices(random: np.random.Generator) -> Iterator[Check]:
    """exp, φ1, φ2, φ3 as blocks of one exponential: that of a matrix beside a chain of ones."""
    z, n, one = 3 * random.normal(size=(2, 4, 4)), 4, np.eye(4)
    told = phi_functions(z)[0]
    for order, name in enumerate(("exp", "φ1", "φ2", "φ3")):
        exact = []
        for matrix in z:
            whole = np.zeros((n * (order + 1), n * (order + 1)))
            whole[:n, :n] = matrix
            for k in range(order):
                whole[n * k : n * (k + 1), n * (k + 1) : n * (k + 2)] = one
            exact.append(expm(whole)[:n, n * order :])
        yield alike(f"{name} of matrices: relative error", 1e-11, told[order], exact)
    uneven = np.diag([1.0, 1e-5, 1e4, 1.0])
    A = uneven @ z[0] @ np.linalg.inv(uneven)
    exact = uneven @ expm(z[0]) @ np.linalg.inv(uneven)
    error = np.abs(exponential(A) / exact - 1).max()
    yield below("exp of a matrix with rows of very different size, entry by entry: relative error", 1e-10, error)


def _one_step() -> Check:
    """The matrix by which growth of errors is judged: a step on a beam whose ends give way, of fourth order."""
    omega, D, S = np.array([7.0, 20.0]), np.array([0.5, 2.0]), np.diag([1.0, 2.0, 0.5])
    C = np.array([[0.3, -0.2], [0.5, 0.1], [0.1, 0.4]])
    beside = np.eye(2) + C.T @ np.linalg.solve(S, C)
    A = np.block([[np.zeros((2, 2)), np.diag(omega)], [-beside * omega, -beside * D]])
    whole, half = (np.abs(one_step(omega, D, C, S, dt) - expm(A * dt)).max() for dt in (0.01, 0.005))
    statement = "the error of a linear step of etdrk4 falls with its length to the power"
    return close(statement, 5.0, np.log2(whole / half), absolute=0.2)
