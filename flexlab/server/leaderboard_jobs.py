"""Work on the leaderboard: its newest table, its figures, and computing what is missing, each in a process of its own."""

from collections.abc import Callable
from pathlib import Path

from flexlab.analysis.leaderboard.board import Leaderboard, make_tasks, run_board
from flexlab.analysis.leaderboard.case import cases, chosen_cases
from flexlab.analysis.leaderboard.entrants import chosen_entrants
from flexlab.analysis.leaderboard.store import RowStore, digest, engine
from flexlab.server.task_book import Outcome

MOST_BOARDS = 4
"""Computations that are remembered: the newest table's, and what drew the figures of it and some before."""


def newest_board(folder: Path) -> tuple[Leaderboard, str]:
    """(the newest table in a folder, what names it): its cases that are still known."""
    known = cases()
    rows = tuple(row for row in RowStore(folder).last() if _is_of(row.case, row.variant))
    found = Leaderboard(tuple(known[name] for name in dict.fromkeys(row.case for row in rows)), rows)
    return found, digest(row.key for row in rows) if rows else ""


def _is_of(case: str, variant: str) -> bool:
    known = cases().get(case)
    return known is not None and any(each.name == variant for each in known.variants)


def is_of_today(board: Leaderboard) -> bool:
    """Whether all rows were computed by the engine as it is now."""
    return all(row.engine == engine() for row in board.rows)


def compute_board(kept: Path, report: Callable[[float], None]) -> Outcome:
    """Compute what is missing of flexlab's own laws in all cases but the long ones."""
    tasks = make_tasks(chosen_cases(None, long=False), chosen_entrants(None))
    board = run_board(tasks, RowStore(kept), told=lambda done, total: report(done / total))
    return Outcome(sentence=f"{len(board.rows)} rows, {board.computed} of them computed now.")


def draw_board(kept: Path) -> Outcome:
    """(What names the newest table, its figures by case as SVG)."""
    from flexlab.analysis.leaderboard.report import svg_text

    board, name = newest_board(kept)
    return Outcome((name, {case.name: svg_text(board, case) for case in board.cases}))
