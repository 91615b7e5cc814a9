"""One BLAS thread, whichever of our threads asks for it, and only for as long as somebody does."""

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
    """Also after another thread, which lives on, has done so: threadpoolctl allows it to the first thread only.

    Runs in a process of its own, as a lab that another test keeps open may hold BLAS here.
    """
    found = subprocess.run([sys.executable, "-c", PROGRAM], check=True, capture_output=True, text=True).stdout
    assert found.strip() == str([{2}, {1}, {2}] * 2)
