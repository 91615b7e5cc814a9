"""Decompositions without Python's global lock: they agree with scipy, and other threads run meanwhile."""

import sys
import threading
import time

import numpy as np
import pytest
import scipy.linalg

from flexlab.lapack import _routine, complex_schur, eigenvectors


@pytest.mark.parametrize("n", [1, 2, 3, 10, 70])
def test_the_schur_form_is_triangular_and_gives_the_matrix_back(n: int):
    A = np.random.default_rng(n).normal(size=(n, n))
    T, Z = complex_schur(A)
    assert np.abs(Z @ T @ Z.conj().T - A).max() < 1e-13 * n
    assert np.abs(Z.conj().T @ Z - np.eye(n)).max() < 1e-13 * n
    assert np.array_equal(T, np.triu(T))


@pytest.mark.parametrize("n", [1, 2, 3, 10, 70])
def test_eigenvectors_are_those_of_scipy(n: int):
    A = np.random.default_rng(n).normal(size=(n, n))
    for ours, theirs in zip(eigenvectors(A), scipy.linalg.eig(A, left=True, right=True), strict=True):
        assert np.abs(ours - theirs).max() < 1e-12


def test_double_and_purely_imaginary_eigenvalues_are_found():
    A = np.array([[0.0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 3], [0, 0, -3, 0]])
    values, left, right = eigenvectors(A)
    assert sorted(values.imag) == pytest.approx([-3, 0, 0, 3])
    assert np.abs(A @ right - right * values).max() < 1e-14
    assert np.abs(left.conj().T @ A - values[:, None] * left.conj().T).max() < 1e-14


@pytest.mark.parametrize("A", [np.zeros((2, 3)), np.zeros((0, 0)), np.array([[np.nan]])])
def test_anything_but_a_finite_square_matrix_is_refused(A: np.ndarray):
    for decompose in (complex_schur, eigenvectors):
        with pytest.raises(ValueError, match="square matrix of finite numbers"):
            decompose(A)


@pytest.mark.parametrize("decompose", [complex_schur, eigenvectors])
def test_other_threads_run_during_a_decomposition(decompose, monkeypatch: pytest.MonkeyPatch):
    """Python itself never takes the lock from a thread here, so this one runs only if a routine has released it."""
    at_work, seen = [], 0

    def watched(name: str, count: int):
        def call(*arguments: int) -> None:
            at_work.append(name)
            _routine(name, count)(*arguments)
            at_work.clear()

        return call

    monkeypatch.setattr("flexlab.lapack._routine", watched)
    thread = threading.Thread(target=decompose, args=(np.random.default_rng(0).normal(size=(400, 400)),))
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1000)
    try:
        thread.start()
        while thread.is_alive():
            time.sleep(1e-4)
            seen += bool(at_work)
    finally:
        sys.setswitchinterval(usual)
    assert seen
