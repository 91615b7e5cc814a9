"""`/lab/`, `/s/<id>/`, the links that lead there, and `/live`: a lab's live data in rerun's viewer."""

import asyncio
from dataclasses import replace
from urllib.parse import urlencode

from aiohttp import hdrs, web
from markupsafe import Markup

from flexlab.errors import FlexlabError, LabError
from flexlab.presets import load_preset, preset_names
from flexlab.recording.store.run_files import SUFFIX
from flexlab.server.auth import (
    LIVE,
    NO_COOKIE,
    WITH_A_PASS,
    has_pass,
    is_foreign_link,
    is_from_own_page,
    is_opened_by_person,
    is_websocket,
    recording_address,
    refuse,
)
from flexlab.server.labs import LOOK_AGAIN, Choice, FullError, Lab
from flexlab.server.pages import button, message
from flexlab.server.proxy import proxy_page, proxy_websocket
from flexlab.server.scenario_links import decode_scenario, scenario_path
from flexlab.server.visitors import (
    checked_name,
    context_of,
    form_of,
    fresh,
    has_teacher_cookie,
    keep_visitor,
    known_visitor_of,
    scheme_of,
    visitor_of,
)

ROUTES = web.RouteTableDef()

LINKED = "shared-scenario"
"""Name of the runs of a scenario that was opened by a link."""
START_PAGE = Markup(' <a class="button quiet" href="/">Start page</a>')
NEW_LAB = Markup('<a class="button" href="/lab/">Open a new lab</a> <a class="button quiet" href="/runs">Runs</a>')
NOT_YOURS = "This lab was closed, or belongs to another browser. You can have one of your own."
LOOK = 0.1
"""Seconds between two checks for new data, which arrive five times a second."""
PATIENCE = 30.0
"""Most seconds that a viewer may take for one piece, after which it is cut off."""
NOT_SERVED = "Live data are served by a lab that was started with --rerun, to people who have that lab open."


@ROUTES.get("/lab")
@ROUTES.get("/lab/")
async def lab(request: web.Request) -> web.StreamResponse:
    """The shared lab, or a redirect to the visitor's own; `?scenario=` opens a scenario in it."""
    context = context_of(request)
    if is_websocket(request):
        place = _place(request)
        if place is None:
            raise web.HTTPNotFound
        return await proxy_websocket(request, place)
    if "scenario" in request.query:
        # A path of thousands of rows takes a second, in which the others are served.
        scenario = await asyncio.to_thread(decode_scenario, request.query["scenario"])
        return await enter_by_link(request, Choice(scenario, LINKED, stands=True))
    if context.places.is_private:
        return await enter_by_link(request, None)
    if not request.path.endswith("/"):
        raise web.HTTPSeeOther("/lab/" + (f"?{raw}" if (raw := request.rel_url.raw_query_string) else ""))
    return await proxy_page(request, await context.places.enter(visitor_of(request), None), "")


@ROUTES.get("/lab/{preset:[^/]+}")
@ROUTES.get("/lab/{preset:[^/]+}/")
async def preset_link(request: web.Request) -> web.StreamResponse:
    """`/lab/<preset>`: open that preset in the lab. Other names may be files of viser's page."""
    name, places = request.match_info["preset"], context_of(request).places
    is_listed = name in await asyncio.to_thread(preset_names)
    if not is_listed and "." in name and not places.is_private:
        return await proxy_page(request, await places.enter(visitor_of(request), None), name)
    try:
        scenario = await asyncio.to_thread(load_preset, name)
    except FlexlabError as error:
        if is_listed:
            raise
        return message("No such preset", str(error), 404)
    return await enter_by_link(request, Choice(scenario, name))


async def enter_by_link(request: web.Request, choice: Choice | None) -> web.StreamResponse:
    """Redirect a visitor who followed a link to the lab, with a scenario if the link leads to one."""
    if request.method == "HEAD":  # A program only asks whether the page is there: the run goes on.
        return web.Response()
    if not is_opened_by_person(request):
        return refuse(request, 403, "A link into the lab must be opened by a person, not from inside another page.")
    if choice is not None:
        # The link would end the run of this lab.
        place = context_of(request).places.of_visitor(visitor_of(request).id)
        if place is not None and is_foreign_link(request):
            return _ask_first(request, choice, "A page of another site leads")
        watched = place is not None and place.visitors > 0 and not context_of(request).places.is_private
        if watched and choice.stands and not is_from_own_page(request):
            return _ask_first(request, choice, "This link leads")
    return await enter_lab(request, choice)


def _ask_first(request: web.Request, choice: Choice, what: str) -> web.Response:
    """A page that asks for consent before a link ends a run that people watch."""
    shared = "" if context_of(request).places.is_private else " for everybody who watches"
    title = choice.scenario.title or choice.name
    sentence = f"{what} to {title}. Opening it ends the present run{shared}; the run is kept."
    more = button("/" + str(request.rel_url).lstrip("/"), "Open it") + START_PAGE
    return message("Open this scenario?", sentence, 200, more)


async def enter_lab(request: web.Request, choice: Choice | None) -> web.StreamResponse:
    """Redirect the visitor to the lab itself, so that a reload does not restart the run."""
    context, visitor = context_of(request), known_visitor_of(request)
    try:
        place = await context.places.enter(visitor, choice)
    except FullError as error:
        here = "/" + str(request.rel_url).lstrip("/") if request.method == "GET" else "/lab/"
        answer = message("No free lab", str(error), 503, button(here, "Try again"))
        if error.place:
            # With the address: a browser would ask for that of a form by GET, which it does not take.
            answer.headers["Refresh"] = f"{LOOK_AGAIN}; url={here}"
            keep_visitor(request, answer, visitor)
        return answer
    except LabError as error:
        return message("The lab did not open", str(error), 503, NEW_LAB)
    # Keep the parameters that the page itself reads (its drawing settings).
    query = request.rel_url.without_query_params("scenario").raw_query_string
    answer = web.Response(status=303, headers={hdrs.LOCATION: f"{place.path}/" + (f"?{query}" if query else "")})
    if context.places.is_private:
        keep_visitor(request, answer, visitor)
    return answer


@ROUTES.post("/name")
async def take_name(request: web.Request) -> web.StreamResponse:
    """Take a visitor's name, then redirect to the lab or the start page."""
    form, visitor = await form_of(request), known_visitor_of(request)
    try:
        named = replace(visitor, name=checked_name(str(form.get("name", ""))))
    except LabError as error:
        return message("This is not a name", str(error), 400)
    context_of(request).places.call(named)
    where = "/lab/?play" if "play" in form else "/lab/" if "enter" in form else "/"
    answer = web.Response(status=303, headers={hdrs.LOCATION: where})
    keep_visitor(request, answer, named)
    return answer


@ROUTES.get("/s/{lab}")
@ROUTES.get("/s/{lab}/")
async def private_lab(request: web.Request) -> web.StreamResponse:
    """A visitor's own lab."""
    place = _place(request)
    if place is None:
        sentence = context_of(request).places.ended(visitor_of(request).id, request.match_info["lab"])
        if is_websocket(request):
            raise web.HTTPGone if sentence else web.HTTPForbidden
        if sentence:
            return message("This lab is closed", sentence, 410, NEW_LAB)
        return message("Not your lab", NOT_YOURS + ("" if request.cookies else NO_COOKIE), 403, NEW_LAB)
    if is_websocket(request):
        return await proxy_websocket(request, place)
    if not request.path.endswith("/"):
        raise web.HTTPSeeOther(f"{place.path}/")
    return await proxy_page(request, place, "")


def _place(request: web.Request) -> Lab | None:
    """The lab named by the address of a page or of its state, if the visitor may enter it."""
    places, path = context_of(request).places, request.path.removeprefix("/state").rstrip("/")
    mine = places.of_visitor(visitor_of(request).id)
    if mine is not None and mine.path == path:
        return mine
    # The teacher may enter all labs.
    others = places.running() if has_teacher_cookie(request) else ()
    return next((place for place in others if place.path == path), None)


@ROUTES.get("/state/lab")
@ROUTES.get("/state/s/{lab}")
async def state(request: web.Request) -> web.Response:
    """The state of a lab, for the script in its page."""
    place = _place(request)
    if place is None:
        sentence = context_of(request).places.ended(visitor_of(request).id, request.match_info.get("lab", ""))
        return fresh({"open": False, "sentence": sentence or NOT_YOURS, "unknown": not sentence})
    status = place.status()
    live = "/live" if place.live is not None else ""
    link = scenario_path(status.link)
    return fresh({"open": True, "name": status.name, "state": status.state, "link": link, "live": live})


def live_name(lab: Lab) -> str:
    """The name of a lab's live data in addresses; a private lab's cannot be guessed."""
    return lab.path.rsplit("/", 1)[-1]


@ROUTES.get("/live")
async def show(request: web.Request) -> web.Response:
    """Redirect to the viewer with the live data of the visitor's lab."""
    context = context_of(request)
    lab = context.places.of_visitor(visitor_of(request).id)
    if lab is None or lab.live is None:
        return message("No live data", NOT_SERVED, 404, button("/", "Start page"))
    place = context.settings.base_url + recording_address(context, LIVE + live_name(lab))
    query = urlencode({"url": f"{scheme_of(request)}://{request.host}{place}", "renderer": "webgl"})
    raise web.HTTPSeeOther(f"/viewer/?{query}&hide_welcome_screen")


@ROUTES.get(f"/{LIVE}{{lab}}{SUFFIX}")
@ROUTES.get(f"{WITH_A_PASS}{{pass}}/{LIVE}{{lab}}{SUFFIX}")
async def stream(request: web.Request) -> web.StreamResponse:
    """A lab's data as an endless rerun file that begins with the stored past."""
    context = context_of(request)
    named = (lab for lab in context.places.running() if live_name(lab) == request.match_info["lab"])
    lab = next(named, None)
    if lab is None or lab.live is None or not _may_watch(request, lab):
        raise web.HTTPNotFound
    # A viewer sends no cookies: whoever has a private lab's pass counts as its visitor.
    asker = visitor_of(request)
    if context.places.is_private:
        asker = replace(asker, id=live_name(lab))
    with context.viewers.place(asker):
        headers = {hdrs.CONTENT_TYPE: "application/octet-stream", hdrs.CACHE_CONTROL: "no-store"}
        answer = web.StreamResponse(headers=headers)
        try:
            await answer.prepare(request)
            if request.method == "GET":
                number = -1
                while not lab.live.is_closed and request.transport is not None and not request.transport.is_closing():
                    number, pieces = lab.live.after(number)
                    for piece in pieces:
                        await asyncio.wait_for(answer.write(piece), PATIENCE)
                    if not pieces:
                        await asyncio.sleep(LOOK)
        except TimeoutError:
            if request.transport is not None:
                request.transport.abort()
        return answer


def _may_watch(request: web.Request, lab: Lab) -> bool:
    """Whether the visitor may watch a lab's live data: it is shared or their own, or they have its pass or are the teacher."""
    places = context_of(request).places
    if not places.is_private or (request.path.startswith(WITH_A_PASS) and has_pass(request)):
        return True
    return lab is places.of_visitor(visitor_of(request).id) or has_teacher_cookie(request)
