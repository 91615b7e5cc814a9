"""One BLAS thread, whichever of our threads asks for it, and only for as long as somebody does."""

import threading

from threadpoolctl import ThreadpoolController, threadpool_limits

from flexlab.sim.blas import one_blas_thread


def threads() -> set[int]:
    return {library["num_threads"] for library in ThreadpoolController().select(user_api="blas").info()}


def test_any_thread_can_hold_blas_to_one_thread():
    """Also after another one, which lives on, has: threadpoolctl lets only the first thread that asked."""
    found = []

    def ask() -> None:
        found.append(threads())
        with one_blas_thread():
            found.append(threads())
        found.append(threads())

    with threadpool_limits(2, user_api="blas"):
        ask()
        other = threading.Thread(target=ask)
        other.start()
        other.join()
    assert found[1] == found[4] == {1}
    assert found[0] == found[2] == found[3] == found[5]
