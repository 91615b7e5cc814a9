"""The cells of a sweep on a Dask cluster: `dask scheduler` on one machine, `dask worker tcp://…` on as many as there are.

The table stays on this machine, and is the same, byte for byte: workers with another engine are refused, and what a worker
had in hand when it died is computed again elsewhere.
"""

import gc
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from flexlab.analysis.sweep.cell import Cell, Executor, run_part
from flexlab.analysis.sweep.plan import Plan, engine
from flexlab.errors import StudyError

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
    return client.submit(compute_part, replace(plan), part, pure=False)


def compute_part(plan: Plan, part: range) -> tuple[str, list[Cell]]:
    """On a worker: its engine, and the cells."""
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
