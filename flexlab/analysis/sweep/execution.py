"""All cells of a sweep on all cores of this machine: parts are computed in any order, and each is saved as it is done."""

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from contextlib import contextmanager
from pathlib import Path

from flexlab.analysis.batch import thread_count
from flexlab.analysis.sweep.cell import Cell, Executor, KnownBeams, run_part
from flexlab.analysis.sweep.plan import Plan
from flexlab.analysis.sweep.table import SweepFolder
from flexlab.errors import StudyError
from flexlab.plain_text import console

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
    from flexlab.analysis.sweep.cluster import on_cluster

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
