"""BLAS is held to one thread, whichever of our threads asks for it, and only for as long as one does."""

import subprocess
import sys

PROGRAM = """
import threading
from threadpoolctl import ThreadpoolController, threadpool_limits
import scipy.linalg
from flexlab.lapack import one_blas_thread

def threads():
    return {library["num_threads"] for library in ThreadpoolController().select(user_api="blas").info()}

def ask():
    found.append(threads())
    with one_blas_thread():
        found.append(threads())
    found.append(threads())

found = []
with threadpool_limits(2, user_api="blas"):
    ask()
    other = threading.Thread(target=ask)
    other.start()
    other.join()
print(found)
"""


def test_any_thread_can_hold_blas_to_one_thread():
    """A second thread can do so while the first lives on; with threadpoolctl alone, only the first could.

    The test runs in a process of its own, as a lab that another test keeps open may hold BLAS in this one.
    """
    found = subprocess.run([sys.executable, "-c", PROGRAM], check=True, capture_output=True, text=True).stdout
    assert found.strip() == str([{2}, {1}, {2}] * 2)
