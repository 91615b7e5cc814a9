"""BLAS on one thread for what is analysed or drawn beside runs: its matrices are small, and idle threads spin on busy cores."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from threadpoolctl import OpenBLASController, ThreadpoolController

_lock = threading.Lock()
_users = 0
_limit: Any = None


@cache
def _libraries() -> ThreadpoolController:
    """The BLAS libraries of this process, looked for once (1 ms), when numpy and scipy have loaded theirs."""
    return ThreadpoolController()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Hold BLAS to one thread until the last of the concurrent users has left."""
    global _users, _limit
    with _lock:
        if _users == 0:
            OpenBLASController.clear_controlling_thread(force=True)
            _limit = _libraries().limit(limits=1, user_api="blas")
        _users += 1
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if _users == 0:
                # The first thread to set a limit keeps the right to, and others' are ignored; `_lock` keeps order here.
                OpenBLASController.clear_controlling_thread(force=True)
                _limit.restore_original_limits()
