"""Small matrices: one BLAS thread is fastest, and idle ones would spin on the cores of other tests."""

from collections.abc import Iterator

import pytest
from threadpoolctl import threadpool_limits


@pytest.fixture(autouse=True, scope="session")
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread."""
    with threadpool_limits(1, user_api="blas"):
        yield
