"""Parallel computation of runs and studies, on threads of this machine or on the workers of a Dask cluster.

The results are the same on both: workers with another engine are refused, and other workers repeat the work of one that died.
Laws and paths in Python are sent along.
"""

import ctypes
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from itertools import islice
from time import sleep
from typing import Any

from flexlab.analysis.metrics.own import OwnMetric, know_own_metrics, own_metrics
from flexlab.arguments import flag, text_or_none, whole_number
from flexlab.compiled import engine
from flexlab.errors import ScenarioError, StudyError
from flexlab.lapack import one_blas_thread
from flexlab.machine import cores
from flexlab.own import hosts
from flexlab.own.endless_calls import CALLS
from flexlab.own.files import know_own_texts, own_texts
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim.samples import Run, Status, empty_samples
from flexlab.sim.signals import own_signals
from flexlab.sim.simulate import sample_count, simulate
from flexlab.text import console


def simulate_many(
    scenarios: Sequence[Scenario | Mapping[str, Any]],
    duration: float = 3.0,
    sample_period: float = 0.001,
    workers: int | None = None,
    progress: bool = True,
    choose: Callable[[Scenario], Scenario] = lambda scenario: scenario,
    cluster: str | None = None,
) -> list[Run]:
    """Simulate every scenario (or plain data of one), in order, on `workers` threads (None: one per core), or on a `cluster`.

    An invalid scenario gives a run without samples whose status is "invalid" and says why; a run that cannot go on ends
    early, as in `simulate`. `progress` draws a bar on a terminal. `choose` changes each scenario. Raises `StudyError` for
    unusable arguments, and for a cluster that fails.
    """
    sample_count(duration, sample_period)
    known = chosen_workers(workers, cluster)
    found: list[Any] = [_chosen(scenario, choose) for scenario in scenarios]
    valid = [number for number, scenario in enumerate(found) if isinstance(scenario, Scenario)]
    with progress_bar(progress, "runs") as told, known() as run:
        simulated = run(partial(_simulated, duration, sample_period), [found[number] for number in valid])
        for done, (number, one) in enumerate(simulated, 1):
            found[valid[number]] = one
            told(done, len(valid))
    return found


def _chosen(scenario: Scenario | Mapping[str, Any], choose: Callable[[Scenario], Scenario]) -> Scenario | Run:
    """A scenario, changed, or a run whose status says why it is not valid."""
    try:
        return choose(scenario if isinstance(scenario, Scenario) else parse_scenario(scenario))
    except ScenarioError as error:
        return _invalid(scenario if isinstance(scenario, Scenario) else Scenario(), str(error))


def _simulated(duration: float, sample_period: float, scenario: Scenario) -> Run:
    try:
        with one_blas_thread():
            return simulate(scenario, duration, sample_period)
    except ScenarioError as error:
        return _invalid(scenario, str(error))


def _invalid(scenario: Scenario, reason: str) -> Run:
    nothing = empty_samples(len(scenario.arms), scenario.payload.coordinate_count, own_signals(scenario))
    return Run(**nothing.signals(), scenario=scenario, status=Status("invalid", reason))


MOST_WORKERS = 256
"""Largest number of threads: more than any machine of today can use."""
THREADS = "flexlab-workers"
"""Prefix of the threads' names."""
PATIENCE = 10.0
"""Longest wait for the scheduler's answer, s."""
AGAIN = 0.1
"""Interval between attempts to end the work under way, s."""
AHEAD = 3
"""Items per thread that are submitted ahead, so that a study of millions does not fill the memory."""
Work = Callable[[Any], Any]
"""The work on one item. A cluster needs one that can be pickled: a function of a module, or a `partial` of one."""
Does = Callable[[Work, Iterable[Any]], Iterator[tuple[int, Any]]]
"""Maps work over items: yields (number of the item, its result) as each is done, in any order. Raises `StudyError`."""
Workers = Callable[[], AbstractContextManager[Does]]
"""A context manager that provides the threads or workers."""


def chosen_workers(workers: int | None = None, cluster: str | None = None) -> Workers:
    """`workers` threads of this machine (None: one per core), or the Dask cluster of a scheduler. Raises `StudyError`."""
    if cluster is None:
        count = cores() if workers is None else whole_number("workers", workers, 1, MOST_WORKERS)
        return partial(_on_threads, count)
    text_or_none("cluster", cluster, "tcp://HOST:8786")
    if workers is not None:
        raise StudyError(
            "workers is the number of threads on this machine, and a cluster has its own: give one of the two."
        )
    try:
        import distributed
    except ImportError:
        raise StudyError("Dask is not installed: pip install 'flexlab[cluster]' brings it.") from None
    return partial(_on_cluster, distributed, cluster)


@contextmanager
def _on_threads(count: int) -> Iterator[Does]:
    """The kernels release Python's lock, so threads suffice. Ctrl-C, or an error, ends the work under way."""
    pool, ended = ThreadPoolExecutor(count, thread_name_prefix=THREADS), threading.Event()
    under_way, busy = set[Future[Any]](), set[int]()

    def run(work: Work, items: Iterable[Any]) -> Iterator[tuple[int, Any]]:
        def one(item: Any) -> Any:
            busy.add(threading.get_ident())
            hosts.run_alone()
            try:
                return None if ended.is_set() else work(item)
            finally:
                busy.discard(threading.get_ident())

        def submitted(most: int) -> dict[Future[Any], int]:
            new = {pool.submit(one, item): number for number, item in islice(left, most)}
            under_way.update(new)
            for future in new:
                future.add_done_callback(under_way.discard)
            return new

        left = enumerate(items)
        ahead = submitted(AHEAD * count)
        while ahead:
            for future in wait(ahead, return_when=FIRST_COMPLETED).done:
                yield ahead.pop(future), future.result()
                ahead |= submitted(1)

    try:
        with CALLS.study():
            yield run
    except BaseException:
        ended.set()
        pool.shutdown(wait=False, cancel_futures=True)
        while under_way:
            for thread in tuple(busy):
                # Python has no other way to end a thread's work. The exception is raised between two calls of the engine's
                # loop, and lost if a library drops it.
                ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), ctypes.py_object(KeyboardInterrupt))
            sleep(AGAIN)
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
        hosts.close_ended()


@contextmanager
def _on_cluster(distributed: Any, address: str) -> Iterator[Does]:
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
    """A worker's engine, and its result; `texts`: laws and paths in Python, which run in processes of their own."""
    know_own_texts(texts)
    know_own_metrics(metrics)
    hosts.run_alone()
    return engine(), work(item)


def _connected(distributed: Any, address: str) -> Any:
    client = distributed.Client.__new__(distributed.Client)
    try:
        client.__init__(address, timeout=PATIENCE, set_as_default=False)
        return client
    except (MemoryError, OSError, TypeError, ValueError) as error:
        # Something other than a scheduler may announce data of any size.
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    # Garbage collection would close it, and would wait for ever while another client is being made.
    with suppress(TimeoutError):
        client.close(timeout=PATIENCE)
    raise StudyError(
        f"No Dask scheduler answers at {address!r:.60} ({reason:.120}): start one with dask scheduler, "
        "and workers with dask worker and its address."
    )


def _threads(client: Any, address: str) -> dict[str, int]:
    """The threads of each worker. Raises `StudyError` if there is no worker, or one with another engine."""
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
            f"The cluster failed ({reason:.160}): mend it and repeat the command; results that were kept are not computed again."
        ) from None
    _check_engine(theirs, "A worker")
    future.release()
    return result


Told = Callable[[int, int], None]
"""Takes (number done, number in all)."""


@contextmanager
def progress_bar(shown: bool, what: str = "cells", how_far: str = "") -> Iterator[Callable[[float, Any], None]]:
    """A progress bar, if `shown` and on a terminal. `how_far`: rich's text beside the bar instead of "3/10"."""
    notes = console(stderr=True)
    if not (flag("progress", shown) and notes.is_terminal):
        yield lambda done, total: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    beside = TextColumn(how_far) if how_far else MofNCompleteColumn()
    columns = TextColumn(what), BarColumn(), beside, TimeRemainingColumn()
    with Progress(*columns, console=notes, transient=True) as progress:
        task = progress.add_task(what, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
