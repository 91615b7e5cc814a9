"""All cells of a sweep on all cores of this machine: parts are computed in any order, and each is saved as it is done.

The table stays on this machine, and is the same, byte for byte: workers with another engine are refused, and what a worker
had in hand when it died is computed again elsewhere.
"""

import gc
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from flexlab.analysis.batch import thread_count
from flexlab.analysis.sweep.plan import Cell, Executor, KnownBeams, Plan, engine, run_part
from flexlab.analysis.sweep.result import SweepFolder
from flexlab.errors import StudyError
from flexlab.own.files import know_own_texts, own_texts
from flexlab.plain_text import console

PATIENCE = 10.0
"""s for the scheduler to answer."""
AHEAD = 3
"""Parts per thread of the cluster that are handed out before their turn."""


def on_cluster(address: str) -> Executor:
    """Compute on the cluster of the scheduler at `address`, as in "tcp://10.0.0.5:8786". Raises `StudyError`."""
    try:
        import distributed
    except ImportError:
        raise StudyError("Dask is not installed: pip install 'flexlab[cluster]' brings it.") from None

    def compute(plan: Plan, parts: Sequence[range]) -> Iterator[list[Cell]]:
        with _connected(distributed, address) as client:
            threads = sum(_workers(client, address).values())
            ready, left = distributed.as_completed(loop=client.loop), iter(parts)
            for part in _up_to(left, AHEAD * threads):
                ready.add(_submit(client, plan, part))
            for future in ready:
                yield _cells(distributed, future)
                for part in _up_to(left, 1):
                    ready.add(_submit(client, plan, part))

    return compute


def _up_to(parts: Iterator[range], count: int) -> Iterator[range]:
    for _ in range(count):
        part = next(parts, None)
        if part is None:
            return
        yield part


def _submit(client: Any, plan: Plan, part: range) -> Any:
    # A copy without what the plan has worked out: drawn samples may be large, and a worker draws the same ones.
    return client.submit(compute_part, own_texts(), replace(plan), part, pure=False)


def compute_part(texts: list[tuple[str, str]], plan: Plan, part: range) -> tuple[str, list[Cell]]:
    """On a worker: its engine, and the cells; `texts`: laws and paths in Python, which run in processes of their own."""
    know_own_texts(texts)
    return engine(), run_part(plan, part)


def _connected(distributed: Any, address: str) -> Any:
    try:
        return distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
    # A client that found nobody closes itself when it is collected. It waits for ever if that is while another one is made.
    gc.collect()
    raise StudyError(
        f"No Dask scheduler answers at {address!r:.60} ({reason:.120}): start one with dask scheduler, "
        "and workers with dask worker and its address."
    )


def _workers(client: Any, address: str) -> dict[str, int]:
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


def _cells(distributed: Any, future: Any) -> list[Cell]:
    try:
        theirs, cells = future.result()
    except (distributed.KilledWorker, OSError, RuntimeError, ImportError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise StudyError(
            f"The cluster failed ({reason:.160}): mend it; the same command then goes on with what is not done."
        ) from None
    _check_engine(theirs, "A worker")
    future.release()
    return cells


Told = Callable[[int, int], None]
"""Is told (cells done, cells in all)."""


def on_threads(workers: int | None = None) -> Executor:
    """Compute on `workers` threads (None: one per core); the kernels hold no lock."""
    workers = thread_count(workers)
    own = threading.local()

    def compute_part(plan: Plan, part: Sequence[int]) -> list[Cell]:
        if not hasattr(own, "beams"):
            own.beams = KnownBeams()
        return run_part(plan, part, own.beams)

    def compute(plan: Plan, parts: Sequence[range]) -> Iterator[list[Cell]]:
        pool = ThreadPoolExecutor(workers, thread_name_prefix="flexlab-sweep")
        try:
            # A few ahead, not all of them: a sweep of millions of cells must not fill the memory with futures.
            left, ahead = iter(parts), set()
            for part in left:
                ahead.add(pool.submit(compute_part, plan, part))
                if len(ahead) > 2 * workers:
                    done, ahead = wait(ahead, return_when=FIRST_COMPLETED)
                    yield from (future.result() for future in done)
            while ahead:
                done, ahead = wait(ahead, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in done)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    return compute


def chosen_executor(workers: int | None = None, cluster: str | None = None) -> Executor:
    """Threads of this machine, or the Dask cluster of a scheduler. Raises `StudyError`."""
    if cluster is None:
        return on_threads(workers)
    if workers is not None:
        raise StudyError("workers says how many threads this machine uses: a cluster has its own; give one of the two.")

    return on_cluster(cluster)


def run_sweep(plan: Plan, folder: Path, executor: Executor, told: Told = lambda done, total: None) -> Path:
    """Compute what is missing of a sweep in its folder; the table's path. Raises `StudyError`.

    May be interrupted or killed at any time: the same call goes on with the parts that are not done, and the table is the
    same, byte for byte.
    """
    kept = SweepFolder(folder, plan)
    if not kept.is_done:
        missing = kept.missing()
        done = plan.cell_count - sum(map(len, missing))
        told(done, plan.cell_count)
        for cells in executor(plan, missing):
            kept.save(cells)
            done += len(cells)
            told(done, plan.cell_count)
    kept.finish()
    return kept.table


@contextmanager
def cell_progress(shown: bool) -> Iterator[Told]:
    """A bar on a terminal, if wished."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    notes = console(stderr=True)
    columns = TextColumn("cells"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    hidden = not (shown and notes.is_terminal)
    with Progress(*columns, console=notes, transient=True, disable=hidden) as progress:
        task = progress.add_task("cells", total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
