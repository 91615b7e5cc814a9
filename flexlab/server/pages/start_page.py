"""`/`: the labs that run, the presets, the newest runs."""

import asyncio
from pathlib import Path
from typing import Any

from aiohttp import web

from flexlab.assets import web_assets_folder
from flexlab.recording.store.run_files import unreadable
from flexlab.server.labs import Lab, state_of
from flexlab.server.pages import page
from flexlab.server.pages.runs_pages import table_values
from flexlab.server.settings import picture_code
from flexlab.server.visitors import LONGEST_NAME, Context, context_of, runs_for, visitor_of
from flexlab.text import with_units

ROUTES = web.RouteTableDef()

NEWEST = 5
"""Number of runs on the start page."""
PICTURE_KINDS = ("webp", "png", "jpg", "svg")


@ROUTES.get("/")
async def start_page(request: web.Request) -> web.Response:
    """The start page."""
    context, pictures = context_of(request), _pictures()
    presets, rows = await asyncio.gather(context.preset_cards.look(pictures), runs_for(request, NEWEST))
    # With private labs, visitors give their names on the start page first.
    first = "/" if context.places.is_private else "/lab/"
    values: dict[str, Any] = table_values(rows, short=True) | {
        "unreadable": "" if rows else await asyncio.to_thread(unreadable, context.settings.logs),
        "presets": presets,
        "pictures": pictures,
        "drawing": context.preset_cards.drawing,
        "now": _now(request, context),
        "outside": await asyncio.to_thread(context.settings.outside_addresses, context.port, first),
        "visitor": visitor_of(request),
        "longest_name": LONGEST_NAME,
        "is_private": context.places.is_private,
        "code": picture_code,
    }
    return page("start.html", "flexlab", kind="start", **values)


def _pictures() -> dict[str, str]:
    """Preset → address of its picture."""
    folder: Path = web_assets_folder() / "pictures"
    found = {path.stem: path for kind in reversed(PICTURE_KINDS) for path in folder.glob(f"*.{kind}")}
    return {name: f"/assets/pictures/{path.name}" for name, path in found.items()}


def _now(request: web.Request, context: Context) -> str:
    """The labs that run now, in a sentence."""
    if not context.places.is_private:
        return " ".join(map(_place_text, context.places.running()))
    running, most = len(context.places.running()), context.settings.max_sessions
    visitor = visitor_of(request)
    mine = context.places.of_visitor(visitor.id)
    if mine is not None:
        own = f"Yours: {_place_text(mine)}"
    elif running >= most:
        own = "You wait in line for one."
    elif context.places.has_room_for(visitor):
        own = "You get one of your own."
    else:
        own = "Your address has as many as it may have."
    return f"{running} of {most} labs in use. {own}"


def _place_text(place: Lab) -> str:
    status = place.status()
    watching = f", {place.visitors} watching" if place.visitors else ""
    return with_units(f"{status.title} is {state_of(place)} (t = {status.time:.0f} s{watching}).")
