"""All pages of the server, put together."""

import asyncio
from pathlib import Path

from aiohttp import web

from flexlab.assets import web_assets_folder
from flexlab.server.auth import LARGEST_BODY, add_headers, answer_in_sentences, check
from flexlab.server.connections import watch_patience
from flexlab.server.pages.bulk_actions import add_bulk_actions
from flexlab.server.pages.compare_page import add_compare_pages
from flexlab.server.pages.lab_pages import add_lab_pages
from flexlab.server.pages.leaderboard_page import add_leaderboard_pages
from flexlab.server.pages.live_pages import add_live_pages
from flexlab.server.pages.page_context import CONTEXT, Context
from flexlab.server.pages.run_actions import add_run_actions
from flexlab.server.pages.runs_pages import add_runs_pages
from flexlab.server.pages.start_page import start_page
from flexlab.server.pages.study_pages import add_study_pages
from flexlab.server.pages.teacher_page import add_teacher_pages
from flexlab.server.pages.upload import add_upload
from flexlab.server.visitors import greet

STATIC = Path(__file__).resolve().parent / "static"
"""Style sheet, scripts and the icon of the server's pages."""
STATIC_POLICY = "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'self'"


def build_app(context: Context) -> web.Application:
    """The web application of one server."""
    app = web.Application(middlewares=[watch_patience, answer_in_sentences, check, greet], client_max_size=LARGEST_BODY)
    app[CONTEXT] = context
    app.on_response_prepare.append(add_headers)
    app.router.add_get("/", start_page)
    add_lab_pages(app.router)
    add_live_pages(app.router)
    add_compare_pages(app.router)
    add_leaderboard_pages(app.router)
    add_run_actions(app.router)
    add_bulk_actions(app.router)
    add_teacher_pages(app.router)
    add_upload(app.router)
    add_runs_pages(app.router)
    add_study_pages(app.router)
    app.router.add_get("/favicon.ico", _icon)
    app.router.add_get("/static/{name}", _static)
    # No listing of folders, no links that lead out of the folder.
    app.router.add_static("/assets/", web_assets_folder())
    return app


async def _static(request: web.Request) -> web.StreamResponse:
    names = await asyncio.to_thread(lambda: {path.name: path for path in STATIC.iterdir()})
    if request.match_info["name"] not in names:
        raise web.HTTPNotFound
    headers = {"Cache-Control": "no-cache", "Content-Security-Policy": STATIC_POLICY}
    return web.FileResponse(names[request.match_info["name"]], headers=headers)


async def _icon(request: web.Request) -> web.StreamResponse:
    return web.FileResponse(STATIC / "icon.svg")
