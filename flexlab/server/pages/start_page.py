"""`/`: what runs, what there is to try, what was recorded last."""

import asyncio
from pathlib import Path

from aiohttp import web

from flexlab.assets import web_assets_folder
from flexlab.recording.store.run_index import list_rows
from flexlab.server.labs.lab_provider import Lab
from flexlab.server.pages.layout import page
from flexlab.server.pages.markup import Markup, fill, join
from flexlab.server.pages.page_context import Context, context_of
from flexlab.server.pages.runs_table import runs_table
from flexlab.server.preset_cards import PresetCard

NEWEST = 5
"""Runs on the start page."""
PICTURE_KINDS = ("webp", "png", "jpg", "svg")

BODY = """<section class="hero">
<h1>Two arms carry a flexible beam</h1>
<p>Simulated, controlled, seen live in your browser. Move a slider and see the beam answer at once; every run is
recorded.</p>
<p class="actions"><a class="button" href="/lab/">Open the lab</a> <span class="now">{now}</span></p>
</section>
<section>
<h2>Start with</h2>
<ul class="cards">
{cards}
</ul>
</section>
<section>
<h2>Newest runs</h2>
{runs}
<p><a href="/runs">All runs</a></p>
</section>
"""
CARD = """<li class="card"><a href="/lab/{name}">
<span class="picture">{picture}</span>
<span class="name">{title}</span>
<code>{name}</code>
</a>
<p>{watch}</p></li>"""
BROKEN = """<li class="card broken"><p><code>{name}</code> {problem}</p></li>"""


async def start_page(request: web.Request) -> web.Response:
    """The page that says hello."""
    context, pictures = context_of(request), _pictures()
    presets, rows = await asyncio.gather(
        context.preset_cards.look(pictures),
        asyncio.to_thread(list_rows, context.settings.logs, NEWEST),
    )
    runs = runs_table(rows, short=True) if rows else Markup("<p>None yet: the lab records every run.</p>")
    cards = join(_card(context, preset, pictures) for preset in presets)
    return page("flexlab", fill(BODY, now=_now(request, context), cards=cards, runs=runs), kind="start")


def _card(context: Context, preset: PresetCard, pictures: dict[str, str]) -> Markup:
    if preset.scenario is None:
        return fill(BROKEN, name=preset.name, problem=preset.problem)
    scenario = preset.scenario
    if preset.name in pictures:
        picture = fill('<img src="{source}" alt="">', source=pictures[preset.name])
    else:
        picture = context.preset_cards.drawing(preset)
    return fill(CARD, name=preset.name, title=scenario.title or preset.name, watch=scenario.watch, picture=picture)


def _pictures() -> dict[str, str]:
    """Preset → address of its picture."""
    folder: Path = web_assets_folder() / "pictures"
    found = {path.stem: path for kind in reversed(PICTURE_KINDS) for path in folder.glob(f"*.{kind}")}
    return {name: f"/assets/pictures/{path.name}" for name, path in found.items()}


def _now(request: web.Request, context: Context) -> str:
    """What runs at this moment, in a sentence."""
    if not context.places.is_private:
        return " ".join(map(_place_text, context.places.running()))
    running, most = len(context.places.running()), context.settings.max_sessions
    mine = context.places.of_visitor(request.cookies.get(context.visitor_cookie, ""))
    own = f" Yours: {_place_text(mine)}" if mine is not None else " You get one of your own."
    return f"{running} of {most} labs in use.{own}"


def _place_text(place: Lab) -> str:
    status = place.status()
    watching = f", {place.visitors} watching" if place.visitors else ""
    return f"{status.title} is {status.state} (t = {status.time:.0f} s{watching})."
