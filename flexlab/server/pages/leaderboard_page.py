"""`/leaderboard`: control laws on the same cases, as last computed here, and a button that computes what is missing."""

import asyncio

from aiohttp import hdrs, web

from flexlab.analysis.leaderboard.summary import OF_THE_BEST, SEVERAL, overview, provenance, sections, settings
from flexlab.errors import FlexlabError
from flexlab.server.leaderboard_jobs import is_of_today
from flexlab.server.pages.page_context import context_of
from flexlab.server.pages.templating import page
from flexlab.server.visitors import asker_of

PLACE = "/leaderboard"
DRAWING_POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'self'"


def add_leaderboard_pages(router: web.UrlDispatcher) -> None:
    """Routes of the leaderboard."""
    router.add_get(PLACE, leaderboard)
    router.add_post(PLACE, start)
    router.add_get(f"{PLACE}/state", state)
    router.add_get(PLACE + "/{name}/{case}.svg", figure)


async def leaderboard(request: web.Request) -> web.Response:
    """The newest table."""
    boards = context_of(request).boards
    board, name = await boards.newest()
    return page(
        "leaderboard.html",
        "Leaderboard",
        here=PLACE,
        kind="board",
        scripts=("leaderboard",),
        name=name,
        state=boards.state,
        outdated=bool(name) and not await asyncio.to_thread(is_of_today, board),
        overview=overview(board),
        sections=sections(board),
        settings=settings(board),
        provenance=provenance(board) if name else "",
        of_the_best=OF_THE_BEST,
        several=SEVERAL,
    )


async def start(request: web.Request) -> web.Response:
    """Compute what is missing; the page tells how it goes."""
    context_of(request).boards.start(asker_of(request))
    raise web.HTTPSeeOther(PLACE)


async def state(request: web.Request) -> web.Response:
    """How the computation stands, for the script in the page."""
    found = context_of(request).boards.state
    told = {"working": found.working, "sentence": found.sentence, "kind": found.kind}
    return web.json_response(told, headers={hdrs.CACHE_CONTROL: "no-store"})


async def figure(request: web.Request) -> web.Response:
    """The figure of a case."""
    name, case = request.match_info["name"], request.match_info["case"]
    board, newest = await context_of(request).boards.newest()
    if name != newest or case not in [known.name for known in board.cases]:
        raise web.HTTPNotFound
    try:
        drawn = await context_of(request).boards.figure(asker_of(request), name, case)
    except FlexlabError as error:
        raise web.HTTPServiceUnavailable(text=str(error)) from None
    if drawn is None:
        raise web.HTTPNotFound
    headers = {"Cache-Control": "max-age=86400", "Content-Security-Policy": DRAWING_POLICY}
    return web.Response(text=drawn, content_type="image/svg+xml", headers=headers)
