"""`/live`: what a lab shows, in rerun's viewer, as it comes; `/live/<lab>.rrd`: the data of it, for any rerun viewer."""

import asyncio
from urllib.parse import urlencode

from aiohttp import hdrs, web

from flexlab.recording.live import LiveHub
from flexlab.recording.store.run_files import SUFFIX
from flexlab.server.auth import LIVE, WITH_A_PASS, recording_address
from flexlab.server.labs.lab_provider import Lab
from flexlab.server.pages.layout import message
from flexlab.server.pages.page_context import context_of
from flexlab.server.pages.templating import button
from flexlab.server.visitors import visitor_of

LOOK = 0.1
"""s between two looks for new data, which come five times a second."""
PATIENCE = 30.0
"""s that a viewer may take for one piece: one that hangs is left."""
MOST_WATCHERS = 16
"""Viewers of one server at once: each takes as much of the line as a film."""

NOT_SERVED = "Live data are served by a lab that was started with --rerun, to whoever has that lab open."


def add_live_pages(router: web.UrlDispatcher) -> None:
    """Routes of live data."""
    router.add_get("/live", show)
    router.add_get(f"/{LIVE}{{lab}}{SUFFIX}", stream)
    router.add_get(f"{WITH_A_PASS}{{pass}}/{LIVE}{{lab}}{SUFFIX}", stream)


def live_name(lab: Lab) -> str:
    """The word under which a lab's live data are found: nobody guesses that of a private lab."""
    return lab.path.rsplit("/", 1)[-1]


async def show(request: web.Request) -> web.Response:
    """The viewer on the data of the visitor's lab."""
    context = context_of(request)
    lab = context.places.of_visitor(visitor_of(request).id)
    if lab is None or lab.live is None:
        return message("No live data", NOT_SERVED, 404, button("/", "Start page"))
    source = f"{request.scheme}://{request.host}{recording_address(context, LIVE + live_name(lab))}"
    viewer = urlencode({"url": source, "renderer": "webgl"}) + "&hide_welcome_screen"
    raise web.HTTPSeeOther(f"/viewer/?{viewer}")


async def stream(request: web.Request) -> web.StreamResponse:
    """A lab's data without an end, as a rerun file: first what is kept of the past."""
    context = context_of(request)
    named = (lab for lab in context.places.running() if live_name(lab) == request.match_info["lab"])
    lab = next(named, None)
    if lab is None or lab.live is None:
        raise web.HTTPNotFound
    watchers = context.watchers
    if len(watchers) >= MOST_WATCHERS:
        return message("Too many viewers", f"{MOST_WATCHERS} viewers watch live data already: close one.", 503)
    headers = {hdrs.CONTENT_TYPE: "application/octet-stream", hdrs.CACHE_CONTROL: "no-store"}
    answer = web.StreamResponse(headers=headers)
    watchers.append(request)
    try:
        await answer.prepare(request)
        if request.method == "GET":
            await _send(request, answer, lab.live)
    except TimeoutError:
        if request.transport is not None:
            request.transport.abort()
    finally:
        watchers.remove(request)
    return answer


async def _send(request: web.Request, answer: web.StreamResponse, hub: LiveHub) -> None:
    number = -1
    while not hub.is_closed and request.transport is not None and not request.transport.is_closing():
        number, pieces = hub.after(number)
        for piece in pieces:
            await asyncio.wait_for(answer.write(piece), PATIENCE)
        if not pieces:
            await asyncio.sleep(LOOK)
