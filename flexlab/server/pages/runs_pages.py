"""`/runs`: the library. `/runs/<id>`: a run in rerun's viewer, its file, its notes, its end."""

import asyncio
import re

from aiohttp import hdrs, web

from flexlab.analysis.metrics.noted import noted_texts
from flexlab.errors import RecordingError
from flexlab.recording.importing import IMPORTED
from flexlab.recording.overlay import MOST_RUNS
from flexlab.recording.repair import finish
from flexlab.recording.store.run_files import SUFFIX
from flexlab.recording.store.run_index import (
    annotate_run,
    delete_run,
    find_row,
)
from flexlab.recording.web_viewer import VIEWER_FILES, viewer_folder
from flexlab.server.auth import WITH_A_PASS, has_pass, recording_address
from flexlab.server.labs.recording_text import little_space
from flexlab.server.pages.layout import message, page
from flexlab.server.pages.page_context import context_of
from flexlab.server.pages.run_actions import EXPORTS, TABLES, check_recorded, recorded_row_of, row_of
from flexlab.server.pages.runs_table import table_values
from flexlab.server.pages.templating import button, render
from flexlab.server.pages.upload import LARGEST_UPLOAD
from flexlab.server.visitors import runs_for

VIEWER_POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; connect-src 'self' data: blob:; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Left alone, the viewer would fetch fonts, look for updates and report its use: it may talk to this address only."""
NO_FILE_NAME = r"[^\w.-]+"
"""What is left out of the name under which a recording is downloaded."""


def add_runs_pages(router: web.UrlDispatcher) -> None:
    """Routes of the library."""
    router.add_get("/runs", library)
    router.add_get("/runs/", library)
    router.add_get("/runs/{run}" + SUFFIX, recording)
    router.add_get(WITH_A_PASS + "{pass}/{run}" + SUFFIX, recording)
    router.add_get("/runs/{run}", review)
    router.add_post("/runs/{run}/notes", save_notes)
    router.add_get("/runs/{run}/delete", ask_to_delete)
    router.add_post("/runs/{run}/delete", delete)
    router.add_get("/viewer/{name:[^/]*}", viewer)


async def library(request: web.Request) -> web.Response:
    """All runs."""
    context = context_of(request)
    rows = await runs_for(request)
    return page(
        "library.html",
        "Runs",
        here="/runs",
        kind="wide" if rows else "text",
        scripts=("runs", "import", "pop") if rows else ("import", "pop"),
        missing=await asyncio.to_thread(context.measuring.look, rows) if rows else 0,
        folder=context.settings.logs,
        little=await asyncio.to_thread(little_space, context.settings.logs),
        tables=TABLES,
        most=MOST_RUNS,
        endings=", ".join(IMPORTED),
        largest=LARGEST_UPLOAD,
        **table_values(rows),
    )


def _no_such_run(error: RecordingError) -> web.Response:
    return message("No such run", str(error), 404, button("/runs", "All runs"))


async def review(request: web.Request) -> web.Response:
    """One run in the viewer, made whole first if its writer died."""
    try:
        row = await row_of(request)
    except RecordingError as error:
        return _no_such_run(error)
    try:
        if row.problem:
            raise RecordingError(row.problem)
        if row.state == "unfinished":
            await asyncio.to_thread(finish, row.path)
            row = await row_of(request)
    except RecordingError as error:
        return message("This run cannot be shown", str(error), 422, render("unshown.html", row=row))
    end = f"{row.begins + row.duration:.10g}" if row.duration is not None else ""
    return page(
        "review.html",
        f"{row.preset} {row.started:%H:%M:%S}",
        here="/runs",
        kind="review",
        scripts=("review", "pop"),
        row=row,
        address=recording_address(context_of(request), row.id),
        replay=context_of(request).replays.state(row),
        begin=f"{row.begins:.10g}",
        end=end,
        span=f"{row.begins:.10g} to {end}" if end else f"from {row.begins:.10g} on",
        exports=EXPORTS,
        noted_texts=noted_texts,
    )


async def recording(request: web.Request) -> web.StreamResponse:
    """The recording's file, in parts if asked for; the viewer loads it from here."""
    try:
        if request.path.startswith(WITH_A_PASS) and has_pass(request):
            # The pass was given to who may see the run: rerun's viewer does not say who asks.
            row = await asyncio.to_thread(find_row, context_of(request).settings.logs, request.match_info["run"])
            check_recorded(row)
        else:
            row = await recorded_row_of(request)
    except RecordingError as error:
        return _no_such_run(error)
    headers = {
        hdrs.CONTENT_TYPE: "application/octet-stream",
        hdrs.CONTENT_DISPOSITION: f'attachment; filename="{re.sub(NO_FILE_NAME, "-", row.id)}{SUFFIX}"',
        hdrs.CACHE_CONTROL: "no-cache",
    }
    return web.FileResponse(row.path, headers=headers)


async def viewer(request: web.Request) -> web.StreamResponse:
    """One of the three files that rerun's viewer is made of."""
    name = request.match_info["name"] or "index.html"
    if name not in VIEWER_FILES:
        raise web.HTTPNotFound
    folder = await asyncio.to_thread(viewer_folder)
    headers = {
        hdrs.CONTENT_TYPE: VIEWER_FILES[name],
        hdrs.CACHE_CONTROL: "no-cache",
        "Content-Security-Policy": VIEWER_POLICY,
    }
    return web.FileResponse(folder / name, headers=headers)


async def save_notes(request: web.Request) -> web.Response:
    """Note, tags and the mark that keeps a run."""
    row, form = await row_of(request), await request.post()
    note, tags = str(form.get("note", "")), str(form.get("tags", ""))
    await asyncio.to_thread(annotate_run, row, note.replace("\r\n", "\n"), tags, "keep" in form)
    raise web.HTTPSeeOther(f"/runs/{row.address}")


async def ask_to_delete(request: web.Request) -> web.Response:
    """A run is gone for ever: ask first."""
    try:
        row = await row_of(request)
    except RecordingError as error:
        return _no_such_run(error)
    return page("delete.html", "Delete?", here="/runs", row=row)


async def delete(request: web.Request) -> web.Response:
    """Delete a run."""
    row = await row_of(request)
    await asyncio.to_thread(delete_run, row)
    raise web.HTTPSeeOther("/runs")
