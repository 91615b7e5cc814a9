"""`/live`: what a lab shows, in rerun's viewer, as it comes; `/live/<lab>.rrd`: the data of it, for any rerun viewer."""

import asyncio
from urllib.parse import urlencode

from aiohttp import hdrs, web

from flexlab.recording.live import LiveHub
from flexlab.recording.store.run_files import SUFFIX
from flexlab.server.auth import LIVE, WITH_A_PASS, has_pass, recording_address
from flexlab.server.labs.lab_provider import Lab
from flexlab.server.limits import Asker
from flexlab.server.pages.layout import message
from flexlab.server.pages.page_context import context_of
from flexlab.server.pages.templating import button
from flexlab.server.visitors import asker_of, has_teacher_cookie, visitor_of

LOOK = 0.1
"""s between two looks for new data, which come five times a second."""
PATIENCE = 30.0
"""s that a viewer may take for one piece: one that hangs is left."""

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
    if lab is None or lab.live is None or not _may_watch(request, lab):
        raise web.HTTPNotFound
    # A viewer sends no cookies: whoever has the pass to a private lab counts as its visitor.
    asker = asker_of(request)
    if context.places.is_private:
        asker = Asker(live_name(lab), asker.address, asker.is_teacher)
    with context.viewers.place(asker):
        return await _watch(request, lab.live)


def _may_watch(request: web.Request, lab: Lab) -> bool:
    """Whether live data are for who asks: the shared lab's for all, others with a pass, for the lab's visitor and the teacher."""
    places = context_of(request).places
    if not places.is_private or (request.path.startswith(WITH_A_PASS) and has_pass(request)):
        return True
    return lab is places.of_visitor(visitor_of(request).id) or has_teacher_cookie(request)


async def _watch(request: web.Request, hub: LiveHub) -> web.StreamResponse:
    headers = {hdrs.CONTENT_TYPE: "application/octet-stream", hdrs.CACHE_CONTROL: "no-store"}
    answer = web.StreamResponse(headers=headers)
    try:
        await answer.prepare(request)
        if request.method == "GET":
            await _send(request, answer, hub)
    except TimeoutError:
        if request.transport is not None:
            request.transport.abort()
    return answer


async def _send(request: web.Request, answer: web.StreamResponse, hub: LiveHub) -> None:
    number = -1
    while not hub.is_closed and request.transport is not None and not request.transport.is_closing():
        number, pieces = hub.after(number)
        for piece in pieces:
            await asyncio.wait_for(answer.write(piece), PATIENCE)
        if not pieces:
            await asyncio.sleep(LOOK)
