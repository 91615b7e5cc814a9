"""The benchmark for Python users: `flexlab.leaderboard`."""

from collections.abc import Sequence
from pathlib import Path

from flexlab.analysis.leaderboard.board import Leaderboard, make_tasks, run_board
from flexlab.analysis.leaderboard.case import Case, chosen_cases
from flexlab.analysis.leaderboard.entrants import AnyLaw, chosen_entrants
from flexlab.analysis.leaderboard.store import FOLDER, RowStore
from flexlab.analysis.workers import chosen_workers, progress_bar
from flexlab.api import file_path


def leaderboard(
    laws: Sequence[AnyLaw] | None = None,
    cases: Sequence[str | Case] | None = None,
    more_laws: Sequence[AnyLaw] = (),
    long: bool = False,
    seed: int = 0,
    folder: str | Path = FOLDER,
    workers: int | None = None,
    cluster: str | None = None,
    progress: bool = True,
) -> Leaderboard:
    """Simulate control laws in the cases of the benchmark, and gather their scores in a table.

    `laws`: names, paths of Python files, or classes of `OwnLaw`; None: flexlab's own, and `more_laws` besides. `cases`: names,
    B1 to B8; None: all, B7 only with `long`. `folder` keeps every row under a hash of scenario, law and engine, so that only
    what changed is computed again. `workers`: threads, None: one per core; or `cluster`: the
    address of a Dask scheduler. A law that fails says why in its row. Raises
    `StudyError` for unusable arguments and `ScenarioError` for a law's file that cannot be used.
    """
    known = chosen_workers(workers, cluster)
    tasks = make_tasks(chosen_cases(cases, long), chosen_entrants(laws, more_laws), seed)
    with progress_bar(progress, "rows") as told:
        return run_board(tasks, RowStore(file_path("folder", folder)), known, told)
