"""`/leaderboard`: control laws on the same cases, as last computed here, and a button that computes what is missing.

Computing and drawing take a process each.
"""

import asyncio
from collections.abc import Callable
from pathlib import Path

from aiohttp import web

from flexlab.analysis.leaderboard.board import Leaderboard, make_tasks, run_board
from flexlab.analysis.leaderboard.case import cases, chosen_cases
from flexlab.analysis.leaderboard.entry import chosen_entrants
from flexlab.analysis.leaderboard.report import OF_THE_BEST, SEVERAL, overview, provenance, sections, settings
from flexlab.analysis.leaderboard.store import FOLDER, RowStore, digest, engine, shipped_rows
from flexlab.errors import FlexlabError
from flexlab.server.pages.page_context import Context, context_of, told
from flexlab.server.pages.templating import page
from flexlab.server.task_book import IDLE, Outcome
from flexlab.server.visitors import asker_of

MOST_BOARDS = 4
"""Computations that are remembered: the newest table's, and what drew the figures of it and some before."""


def newest_board(folder: Path) -> tuple[Leaderboard, str]:
    """(the newest table in a folder, or the one that came with flexlab; what names it): its cases that are still known."""
    known = cases()
    rows = tuple(row for row in RowStore(folder).last() if _is_of(row.case, row.variant)) or shipped_rows()
    found = Leaderboard(tuple(known[name] for name in dict.fromkeys(row.case for row in rows)), rows)
    return found, digest(row.key for row in rows)


def came_along(board: Leaderboard) -> bool:
    """Whether nothing was computed here yet."""
    return board.rows == shipped_rows()


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
    from flexlab.analysis.leaderboard.report import page_figure

    board, name = newest_board(kept)
    return Outcome((name, {case.name: page_figure(board, case) for case in board.cases}))


PLACE = "/leaderboard"
TABLE = "table"
"""The task that computes it; those that draw are called as what they draw."""
DRAWING_POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'self'"


def add_leaderboard_pages(router: web.UrlDispatcher) -> None:
    """Routes of the leaderboard."""
    router.add_get(PLACE, leaderboard)
    router.add_post(PLACE, start)
    router.add_get(f"{PLACE}/state", state)
    router.add_get(PLACE + "/{name}/{case}.svg", figure)


def _folder(context: Context) -> Path:
    """Where rows are kept, from one server to the next."""
    return context.settings.logs.parent / FOLDER


async def _newest(context: Context) -> tuple[Leaderboard, str]:
    """(The newest table, what names it)."""
    return await asyncio.to_thread(newest_board, _folder(context))


async def leaderboard(request: web.Request) -> web.Response:
    """The newest table."""
    context = context_of(request)
    board, name = await _newest(context)
    return page(
        "leaderboard.html",
        "Leaderboard",
        here=PLACE,
        kind="board",
        name=name,
        task=context.boards.get(TABLE) or IDLE,
        came_along=came_along(board),
        outdated=not came_along(board) and not await asyncio.to_thread(is_of_today, board),
        overview=overview(board),
        sections=sections(board),
        settings=settings(board),
        provenance=provenance(board),
        of_the_best=OF_THE_BEST,
        several=SEVERAL,
    )


async def start(request: web.Request) -> web.Response:
    """Compute what is missing; the page tells how it goes."""
    context = context_of(request)
    context.boards.start("Leaderboard", TABLE, asker_of(request), compute_board, _folder(context))
    raise web.HTTPSeeOther(PLACE)


async def state(request: web.Request) -> web.Response:
    """How the computation stands, for the script in the page."""
    return told(context_of(request).boards.get(TABLE))


async def figure(request: web.Request) -> web.Response:
    """The figure of a case."""
    name, case = request.match_info["name"], request.match_info["case"]
    context = context_of(request)
    board, newest = await _newest(context)
    if name != newest or case not in [known.name for known in board.cases]:
        raise web.HTTPNotFound
    try:
        task = await context.boards.finished("Figures", name, asker_of(request), draw_board, _folder(context))
    except FlexlabError as error:
        raise web.HTTPServiceUnavailable(text=str(error)) from None
    drawn, figures = task.result
    if drawn != name:
        raise web.HTTPNotFound
    headers = {"Cache-Control": "max-age=86400", "Content-Security-Policy": DRAWING_POLICY}
    return web.Response(text=figures[case], content_type="image/svg+xml", headers=headers)
