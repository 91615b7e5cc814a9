"""Who computes many things at once: threads of this machine, or the workers of a Dask cluster. One way for all studies.

Results are the same whoever computes: workers with another engine are refused, and what a worker had in hand when it died is
computed again elsewhere. Laws and paths in Python travel along.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from itertools import islice
from typing import Any

from flexlab.analysis.metrics.own import OwnMetric, know_own_metrics, own_metrics
from flexlab.compiled import cache_folder
from flexlab.errors import StudyError
from flexlab.own.files import know_own_texts, own_texts
from flexlab.plain_text import console

MOST_WORKERS = 256
"""More threads than any machine of today has use for."""
PATIENCE = 10.0
"""s for the scheduler to answer."""
AHEAD = 3
"""Things per thread that are handed out before their turn: a study of millions must not fill the memory."""

Work = Callable[[Any], Any]
"""What is done with each thing. A cluster takes what can be pickled: a function of a module, or a `partial` of one."""
Run = Callable[[Work, Iterable[Any]], Iterator[tuple[int, Any]]]
"""Does a work with some things; (a thing's number, its result) of each as it is done, in any order. Raises `StudyError`."""
Workers = Callable[[], AbstractContextManager[Run]]
"""Those who compute; they are there within the context."""


def engine() -> str:
    """A name for the numerical sources that compute here."""
    return cache_folder().name


def chosen_workers(workers: int | None = None, cluster: str | None = None) -> Workers:
    """So many threads of this machine (None: one per core), or the Dask cluster of a scheduler. Raises `StudyError`."""
    if cluster is None:
        return partial(_on_threads, thread_count(workers))
    if workers is not None:
        raise StudyError("workers says how many threads this machine uses: a cluster has its own; give one of the two.")
    try:
        import distributed
    except ImportError:
        raise StudyError("Dask is not installed: pip install 'flexlab[cluster]' brings it.") from None
    return partial(_on_cluster, distributed, cluster)


def thread_count(workers: int | None) -> int:
    """How many threads to use: one per core for None. Raises `StudyError` for what is no usable number."""
    workers = os.cpu_count() or 1 if workers is None else workers
    if isinstance(workers, bool) or not isinstance(workers, int) or not 1 <= workers <= MOST_WORKERS:
        raise StudyError(f"workers = {workers!r} is not usable: give a whole number from 1 to {MOST_WORKERS}, or None.")
    return workers


@contextmanager
def _on_threads(count: int) -> Iterator[Run]:
    """The kernels hold no lock, so threads are enough."""
    pool = ThreadPoolExecutor(count, thread_name_prefix="flexlab-workers")

    def run(work: Work, items: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        left = enumerate(items)
        ahead = {pool.submit(work, item): number for number, item in islice(left, AHEAD * count)}
        while ahead:
            for future in wait(ahead, return_when=FIRST_COMPLETED).done:
                yield ahead.pop(future), future.result()
                ahead |= {pool.submit(work, item): number for number, item in islice(left, 1)}

    try:
        yield run
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _on_cluster(distributed: Any, address: str) -> Iterator[Run]:
    with _connected(distributed, address) as client:
        threads = sum(_threads(client, address).values())

        def run(work: Work, items: Iterable[Any]) -> Iterator[tuple[int, Any]]:
            ready, left, numbers = distributed.as_completed(loop=client.loop), enumerate(items), dict[Any, int]()

            def hand_out(count: int) -> None:
                for number, item in islice(left, count):
                    future = client.submit(compute_there, own_texts(), own_metrics(), work, item, pure=False)
                    numbers[future] = number
                    ready.add(future)

            hand_out(AHEAD * threads)
            for future in ready:
                yield numbers.pop(future), _result(distributed, future)
                hand_out(1)

        yield run


def compute_there(texts: list[tuple[str, str]], metrics: list[OwnMetric], work: Work, item: Any) -> tuple[str, Any]:
    """On a worker: its engine, and the result; `texts`: laws and paths in Python, which run in processes of their own."""
    know_own_texts(texts)
    know_own_metrics(metrics)
    return engine(), work(item)


def _connected(distributed: Any, address: str) -> Any:
    client = distributed.Client.__new__(distributed.Client)
    try:
        client.__init__(address, timeout=PATIENCE, set_as_default=False)
        return client
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    # Left to be collected, it would close itself then, and wait for ever if that is while another one is made.
    client.close(timeout=PATIENCE)
    raise StudyError(
        f"No Dask scheduler answers at {address!r:.60} ({reason:.120}): start one with dask scheduler, "
        "and workers with dask worker and its address."
    )


def _threads(client: Any, address: str) -> dict[str, int]:
    """Threads of each worker. Raises `StudyError` if there is none, or one that would compute something else."""
    workers = client.nthreads()
    if not workers:
        raise StudyError(f"The cluster at {address} has no workers: start some with dask worker {address}.")
    try:
        engines = client.run(engine)
    except Exception as error:
        raise StudyError(f"A worker cannot compute ({error!r:.120}): install the same flexlab there.") from None
    for worker, theirs in engines.items():
        _check_engine(theirs, f"The worker {worker}")
    return workers


def _check_engine(theirs: str, who: str) -> None:
    if theirs != engine():
        raise StudyError(f"{who} has another version of flexlab: install the same one there, as results would differ.")


def _result(distributed: Any, future: Any) -> Any:
    try:
        theirs, result = future.result()
    except (distributed.KilledWorker, CancelledError, OSError, RuntimeError, ImportError) as error:
        reason = getattr(error, "reason", "") or (str(error).splitlines() or [type(error).__name__])[0]
        raise StudyError(
            f"The cluster failed ({reason:.160}): mend it, and give the same command again; what is kept is not computed anew."
        ) from None
    _check_engine(theirs, "A worker")
    future.release()
    return result


Told = Callable[[int, int], None]
"""Is told (things done, things in all)."""


@contextmanager
def progress_bar(shown: bool, what: str = "cells") -> Iterator[Told]:
    """A bar on a terminal, if wished."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    notes = console(stderr=True)
    columns = TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    hidden = not (shown and notes.is_terminal)
    with Progress(*columns, console=notes, transient=True, disable=hidden) as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
