"""flexlab's linear algebra against numpy, scipy and closed forms: random, ill-conditioned and repeated cases."""

import numpy as np
import pytest
import scipy.linalg

from flexlab.numerics.eigenvalues import balanced, eigenvalues, eigenvector, power_sizes, spectral_radius
from flexlab.numerics.linear_algebra import NoSolution, cholesky, inverse, product, singular_vectors, solve
from flexlab.numerics.matrix_functions import discrete_riccati, doublings_to, exponential, phi_functions

EPSILON = np.finfo(float).eps
SIZES = (1, 2, 3, 7, 30, 129)


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(11)


@pytest.mark.parametrize("n", SIZES)
def test_products_are_those_of_numpy(n: int, random: np.random.Generator) -> None:
    A, B, v = random.normal(size=(n, n + 3)), random.normal(size=(n + 3, 2)), random.normal(size=n + 3)
    for one, other in ((A, B), (A, v), (v, B), (v, v), (B.T, A.T)):
        found, expected = product(one, other), one @ other
        assert np.shape(found) == np.shape(expected)
        np.testing.assert_allclose(found, expected, rtol=0, atol=8 * n * EPSILON * np.abs(A).max() * 4)
    stack = random.normal(size=(5, n + 3, 4))
    np.testing.assert_allclose(product(A, stack), A @ stack, rtol=0, atol=64 * n * EPSILON)


@pytest.mark.parametrize("n", SIZES)
def test_a_product_is_summed_in_ascending_order_of_the_index(n: int, random: np.random.Generator) -> None:
    A, B = random.normal(size=(n, n)), random.normal(size=(n, n))
    expected = np.zeros((n, n))
    for k in range(n):
        expected = expected + np.outer(A[:, k], B[k])
    assert product(A, B).tobytes() == expected.tobytes()


@pytest.mark.parametrize("n", SIZES)
def test_ill_conditioned_equations_are_solved_with_a_small_residual(n: int, random: np.random.Generator) -> None:
    A = random.normal(size=(n, n)) * np.logspace(0, -9, n)
    X = solve(A, np.eye(n))
    residual = np.abs(A @ X - np.eye(n)).max() / (np.abs(A).max() * np.abs(X).max())
    assert residual < 30 * n * EPSILON
    assert np.array_equal(inverse(A), X)
    assert solve(A, A[:, 0]).shape == (n,)


def test_a_problem_without_a_solution_raises_an_error() -> None:
    with pytest.raises(NoSolution):
        solve(np.ones((3, 3)), np.eye(3))
    with pytest.raises(NoSolution):
        solve(np.full((2, 2), np.nan), np.eye(2))
    with pytest.raises(NoSolution):
        cholesky(np.diag([1.0, -1.0]))


@pytest.mark.parametrize("n", SIZES)
def test_cholesky_rebuilds_the_matrix_and_singular_values_are_numpys(n: int, random: np.random.Generator) -> None:
    A = random.normal(size=(n + 2, n))
    S = A.T @ A
    R = cholesky(S)
    assert np.array_equal(R, np.triu(R))
    np.testing.assert_allclose(R.T @ R, S, rtol=0, atol=8 * n * EPSILON * np.abs(S).max())
    sigma, W = singular_vectors(A)
    np.testing.assert_allclose(sigma, np.linalg.svd(A)[1][::-1], rtol=0, atol=8 * n * EPSILON * sigma[-1])
    np.testing.assert_allclose(W.T @ W, np.eye(n), rtol=0, atol=1e-13)
    lengths = np.linalg.norm(A @ W, axis=0)
    np.testing.assert_allclose(lengths, sigma, rtol=0, atol=8 * n * EPSILON * sigma[-1])


def test_repeated_and_small_singular_values_keep_their_digits(random: np.random.Generator) -> None:
    U, W = (np.linalg.qr(random.normal(size=(6, 6)))[0] for _ in range(2))
    for wanted in ([1.0, 1.0, 2.0, 2.0, 2.0, 5.0], [1.0] * 6):
        np.testing.assert_allclose(singular_vectors(U @ np.diag(wanted) @ W)[0], wanted, rtol=1e-14)
    # Columns of very different lengths: each value keeps its relative accuracy, which no bidiagonal method achieves.
    steep = np.linalg.qr(random.normal(size=(6, 6)))[0] * np.logspace(-12, 0, 6)
    np.testing.assert_allclose(singular_vectors(steep)[0], np.logspace(-12, 0, 6), rtol=1e-14)


@pytest.mark.parametrize("n", SIZES)
def test_eigenvalues_are_those_of_numpy_and_eigenvectors_belong_to_them(n: int, random: np.random.Generator) -> None:
    A = random.normal(size=(n, n)) * np.logspace(0, 3, n)
    found, expected = eigenvalues(A), np.linalg.eigvals(A)
    scale = np.abs(expected).max()
    assert max(np.abs(expected - value).min() for value in found) < 1e-11 * scale
    assert max(np.abs(found - value).min() for value in expected) < 1e-11 * scale
    pairs = found[found.imag > 0]
    assert all(value.conjugate() in found for value in pairs)
    for value in found[:3]:
        v = eigenvector(A, value)
        assert np.linalg.norm(v) == pytest.approx(1, rel=1e-14)
        np.testing.assert_allclose(A @ v, value * v, rtol=0, atol=1e-11 * n * np.abs(A).max())
    assert spectral_radius(A) == pytest.approx(scale, rel=3e-4)


def test_eigenvalues_are_those_of_closed_forms() -> None:
    rotation = np.array([[0.0, -2.0], [2.0, 0.0]])
    assert sorted(eigenvalues(rotation), key=lambda value: value.imag) == [-2j, 2j]
    defective = np.array([[3.0, 1.0, 0.0], [0.0, 3.0, 1.0], [0.0, 0.0, 3.0]])
    assert np.array_equal(eigenvalues(defective), [3, 3, 3])
    assert np.array_equal(eigenvalues(np.zeros((4, 4))), np.zeros(4))
    n = 40
    chain = 2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    known = 2 - 2 * np.cos(np.arange(1, n + 1) * np.pi / (n + 1))
    np.testing.assert_allclose(np.sort(eigenvalues(chain).real), known, rtol=0, atol=1e-13)
    cycle = np.roll(np.eye(7), 1, axis=0)  # Without an exceptional shift, Francis's steps make no progress on it.
    np.testing.assert_allclose(np.abs(eigenvalues(cycle)), np.ones(7), rtol=1e-14)


def test_balancing_is_exact(random: np.random.Generator) -> None:
    A = random.normal(size=(6, 6)) * np.logspace(-8, 8, 6) / np.logspace(-8, 8, 6)[:, None]
    even, scale = balanced(A)
    assert np.array_equal(even * scale[:, None] / scale, A)
    assert np.abs(even).max() < 1e3


def test_powers_of_a_matrix_grow_as_those_of_its_largest_eigenvalue() -> None:
    half, size = power_sizes(np.diag([0.5, 1.25]), 10)
    assert (size - half) / 512 == pytest.approx(np.log(1.25), rel=1e-12)
    assert size == pytest.approx(1024 * np.log(1.25), rel=1e-12)


@pytest.mark.parametrize("size", [1e-6, 0.3, 4.0, 300.0])
def test_exponentials_and_phi_functions_are_those_of_scipy(size: float, random: np.random.Generator) -> None:
    A = random.normal(size=(8, 8))
    A = size * (A - A.T - 0.3 * np.eye(8))
    np.testing.assert_allclose(exponential(A), scipy.linalg.expm(A), rtol=0, atol=1e-15 * max(30.0, 30 * size))
    whole = np.zeros((32, 32))
    whole[:8, :8] = A
    for block in range(3):
        whole[8 * block : 8 * block + 8, 8 * block + 8 : 8 * block + 16] = np.eye(8)
    expected = scipy.linalg.expm(whole)[:8]
    for found, wanted in zip(phi_functions(A)[0], np.hsplit(expected, 4), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-15 * max(30.0, 30 * size))


def test_a_slow_part_beside_a_fast_one_keeps_its_digits() -> None:
    A = np.array([[-1e-9, 0.0, 1.0], [0.0, -1e3, 0.0], [0.0, 0.0, -1e-9]])
    found = exponential(A)
    assert found[0, 0] - 1 == pytest.approx(-1e-9, rel=1e-6)
    assert found[0, 2] == pytest.approx(1 - 1e-9, rel=1e-15)


@pytest.mark.parametrize(("n", "m"), [(1, 1), (4, 2), (14, 3), (22, 10)])
def test_riccati_solutions_are_those_of_scipy_and_stabilise(n: int, m: int, random: np.random.Generator) -> None:
    A, B = random.normal(size=(n, n)) / 2, random.normal(size=(n, m))
    Q, R = np.diag(np.logspace(-3, 3, n)), np.diag(np.logspace(-4, 0, m))
    P = discrete_riccati(A, B, Q, R)
    expected = scipy.linalg.solve_discrete_are(A, B, Q, R)
    np.testing.assert_allclose(P, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    K = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    assert np.abs(np.linalg.eigvals(A - B @ K)).max() < 1
    residual = A.T @ P @ A - A.T @ P @ B @ K + Q - P
    assert np.abs(residual).max() < 1e-11 * np.abs(P).max()


def test_a_scalar_riccati_equation_gives_its_closed_form_or_an_error() -> None:
    one = np.ones((1, 1))
    assert discrete_riccati(one, one, one, one)[0, 0] == pytest.approx((1 + np.sqrt(5)) / 2, rel=1e-14)
    with pytest.raises(NoSolution):
        discrete_riccati(2 * one, 0 * one, one, one)


def test_doublings_are_as_few_as_reach_the_value() -> None:
    assert [doublings_to(value, 0.5) for value in (0.0, 0.4, 0.5, 0.51, 1.0, 1.1, 300.0)] == [0, 0, 0, 1, 1, 2, 10]
