"""`/leaderboard`: the newest table of control laws on the same cases, and a button that computes the missing rows.

Computing and drawing run in separate processes.
"""

import asyncio
from collections.abc import Callable
from pathlib import Path

from aiohttp import web

from flexlab.analysis.leaderboard.board import Leaderboard, make_tasks, run_board
from flexlab.analysis.leaderboard.case import cases, chosen_cases
from flexlab.analysis.leaderboard.entry import chosen_entrants
from flexlab.analysis.leaderboard.report import page_figure, page_values
from flexlab.analysis.leaderboard.store import FOLDER, RowStore, engine, shipped_rows
from flexlab.errors import FlexlabError
from flexlab.files import short_hash
from flexlab.server.pages import DRAWING_POLICY, page
from flexlab.server.task_book import IDLE, Outcome
from flexlab.server.visitors import Context, context_of, told, visitor_of

ROUTES = web.RouteTableDef()

PLACE = "/leaderboard"
TABLE = "table"
"""Key of the computing task; a drawing task has the table's digest as its key."""


def newest_board(folder: Path) -> tuple[Leaderboard, str]:
    """(the newest table in a folder, or else the one that ships with flexlab; its digest), limited to cases that still exist."""
    known = cases()
    variants = {(case.name, variant.name) for case in known.values() for variant in case.variants}
    rows = tuple(row for row in RowStore(folder).last() if (row.case, row.variant) in variants) or shipped_rows()
    found = Leaderboard(tuple(known[name] for name in dict.fromkeys(row.case for row in rows)), rows)
    return found, short_hash("".join(row.key for row in rows))


def compute_board(kept: Path, report: Callable[[float], None]) -> Outcome:
    """Compute the missing rows of flexlab's own laws in all cases but the long ones."""
    tasks = make_tasks(chosen_cases(None, long=False), chosen_entrants(None))
    board = run_board(tasks, RowStore(kept), told=lambda done, total: report(done / total))
    return Outcome(sentence=f"Rows: {len(board.rows)}, computed now: {board.computed}.")


def draw_board(kept: Path) -> Outcome:
    """Draw the newest table; the result is (its digest, its figures by case as SVG)."""
    board, name = newest_board(kept)
    return Outcome((name, {case.name: page_figure(board, case) for case in board.cases}))


def _folder(context: Context) -> Path:
    """The folder of rows, which later servers use too."""
    return context.settings.logs.parent / FOLDER


async def _newest(context: Context) -> tuple[Leaderboard, str]:
    return await asyncio.to_thread(newest_board, _folder(context))


@ROUTES.get(PLACE)
async def leaderboard(request: web.Request) -> web.Response:
    """The page with the newest table."""
    context = context_of(request)
    board, name = await _newest(context)
    came_along = board.rows == shipped_rows()
    present = await asyncio.to_thread(engine)
    return page(
        "leaderboard.html",
        "Leaderboard",
        here=PLACE,
        kind="board",
        name=name,
        task=context.boards.get(TABLE) or IDLE,
        came_along=came_along,
        outdated=not came_along and any(row.engine != present for row in board.rows),
        **page_values(board),
    )


@ROUTES.post(PLACE)
async def start(request: web.Request) -> web.Response:
    """Start computing the missing rows; the page shows the progress."""
    context = context_of(request)
    context.boards.start("Leaderboard", TABLE, visitor_of(request), compute_board, _folder(context))
    raise web.HTTPSeeOther(PLACE)


@ROUTES.get(f"{PLACE}/state")
async def state(request: web.Request) -> web.Response:
    """The progress of the computation, for the script in the page."""
    return told(context_of(request).boards.get(TABLE))


@ROUTES.get(PLACE + "/{name}/{case}.svg")
async def figure(request: web.Request) -> web.Response:
    """The figure of a case."""
    name, case = request.match_info["name"], request.match_info["case"]
    context = context_of(request)
    board, newest = await _newest(context)
    if name != newest or case not in [known.name for known in board.cases]:
        raise web.HTTPNotFound
    try:
        task = await context.boards.finished("Figures", name, visitor_of(request), draw_board, _folder(context))
    except FlexlabError as error:
        raise web.HTTPServiceUnavailable(text=str(error)) from None
    drawn, figures = task.result
    if drawn != name:
        raise web.HTTPNotFound
    headers = {"Cache-Control": "max-age=86400", "Content-Security-Policy": DRAWING_POLICY}
    return web.Response(text=figures[case], content_type="image/svg+xml", headers=headers)
