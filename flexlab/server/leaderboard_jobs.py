"""The leaderboard of one server: its newest table, whether it is being computed, and its figures."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from flexlab.analysis.leaderboard.board import Leaderboard, make_tasks, run_board
from flexlab.analysis.leaderboard.case import cases, chosen_cases
from flexlab.analysis.leaderboard.entrants import chosen_entrants
from flexlab.analysis.leaderboard.store import RowStore, digest, engine
from flexlab.errors import FlexlabError
from flexlab.server.limits import Asker
from flexlab.server.tasks import Tasks


@dataclass(frozen=True)
class BoardState:
    """How the computation stands."""

    working: bool
    sentence: str
    kind: str = ""
    """"good" or "bad" once it is over."""


IDLE = BoardState(False, "")


class Boards:
    """At most one computation at a time. For the server's event loop only."""

    def __init__(self, tasks: Tasks, folder: Path):
        """`folder`: where rows are kept, from one server to the next."""
        self._tasks, self._folder = tasks, folder
        self.state = IDLE
        self._task: asyncio.Task[None] | None = None
        self._drawn: tuple[str, dict[str, str]] = ("", {})
        self._drawing = asyncio.Lock()

    def start(self, asker: Asker) -> None:
        """Compute what is missing of flexlab's own laws in all cases but the long ones, unless that is being done.

        Raises `BusyError`.
        """
        if not self.state.working:
            self._tasks.check(asker)
            self.state = BoardState(True, "Starting")
            self._task = asyncio.create_task(self._compute(asker))

    async def _compute(self, asker: Asker) -> None:
        def report(share: float) -> None:
            self.state = BoardState(True, f"Computing: {100 * share:.0f} %")

        try:
            computed, rows = await self._tasks.run(asker, compute_board, self._folder, on_progress=report)
        except FlexlabError as error:
            self.state = BoardState(False, f"Not computed to the end: {error} What is done is kept.", "bad")
        else:
            self.state = BoardState(False, f"{rows} rows, {computed} of them computed now.", "good")

    async def newest(self) -> tuple[Leaderboard, str]:
        """(the newest table, what names it; empty if there is none)."""
        return await asyncio.to_thread(newest_board, self._folder)

    async def figure(self, asker: Asker, name: str, case: str) -> str | None:
        """The figure of a case of the table `name`, SVG; None if that table is not the newest. Raises `FlexlabError`."""
        async with self._drawing:
            if self._drawn[0] != name:
                self._drawn = await self._tasks.run(asker, draw_board, self._folder)
        return self._drawn[1].get(case) if self._drawn[0] == name else None


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


def compute_board(folder: Path, report: Callable[[float], None]) -> tuple[int, int]:
    """A job: (rows computed now, rows in all)."""
    tasks = make_tasks(chosen_cases(None, long=False), chosen_entrants(None))
    board = run_board(tasks, RowStore(folder), told=lambda done, total: report(done / total))
    return board.computed, len(board.rows)


def draw_board(folder: Path) -> tuple[str, dict[str, str]]:
    """A job: (what names the newest table, its figures by case)."""
    from flexlab.analysis.leaderboard.report import svg_text

    board, name = newest_board(folder)
    return name, {case.name: svg_text(board, case) for case in board.cases}
