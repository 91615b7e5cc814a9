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
    RunRow,
    annotate_run,
    delete_run,
    duration_text,
    list_rows,
    size_text,
    state_word,
)
from flexlab.recording.web_viewer import VIEWER_FILES, viewer_folder
from flexlab.server.auth import WITH_A_PASS, recording_address
from flexlab.server.pages.layout import message, page
from flexlab.server.pages.markup import Markup, fill, join
from flexlab.server.pages.page_context import context_of
from flexlab.server.pages.run_actions import EXPORTS, recorded_row_of, row_of
from flexlab.server.pages.runs_table import runs_table
from flexlab.server.pages.upload import LARGEST_UPLOAD
from flexlab.server.replay_jobs import ReplayState

VIEWER_POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; connect-src 'self' data: blob:; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Left alone, the viewer would fetch fonts, look for updates and report its use: it may talk to this address only."""
NO_FILE_NAME = r"[^\w.-]+"
"""What is left out of the name under which a recording is downloaded."""
SCRIPT = Markup('<script src="/static/{}.js" defer></script>')
LIBRARY_SCRIPTS = Markup("\n".join(map(SCRIPT.format, ("runs", "import", "pop"))))
IMPORT_SCRIPTS = Markup("\n".join(map(SCRIPT.format, ("import", "pop"))))
REVIEW_SCRIPTS = Markup("\n".join(map(SCRIPT.format, ("review", "pop"))))

LIBRARY = """<h1>Runs</h1>
<div class="tools"><input type="search" id="search" placeholder="Search {count} runs" aria-label="Search runs"
autocomplete="off">
<form id="compare" action="/compare"><button class="button" data-most="{most}">Compare</button></form>
{import_form}
<span>{total} in {folder}</span> <span>{measuring}</span></div>
{table}
<p id="nothing" hidden>No run matches.</p>
"""
NO_RUNS = """<h1>Runs</h1><p>There is no run in {folder} yet: the lab records every run.</p>
<div class="tools"><a class="button" href="/lab/">Open the lab</a> {import_form}</div>"""
IMPORT = """<details class="pop" name="pop"><summary class="button quiet">Import</summary>
<form method="post" action="/runs/import" enctype="multipart/form-data" id="import" data-largest="{largest}">
<label>A run that was exported, or a recording: {endings}, at most {size}
<input type="file" name="file" accept="{endings}" required></label>
<p class="problem" role="alert" hidden></p>
<button class="button">Import</button>
</form></details>"""

REVIEW = """<div class="review-head">
<h1>{preset}</h1>
<p>{started} · {duration} · {size} · <span class="state {kind}">{state}</span>{tag_list}</p>
<div class="actions">
<details class="pop" name="pop"><summary class="button quiet">Continue</summary>
<form method="post" action="/runs/{place}/continue">
<label>Open the lab at simulation time t, in s ({span}); empty: at the end
<input type="number" name="time" step="any" inputmode="decimal" placeholder="{end}"></label>
<button class="button">Continue from here</button>
</form></details>
<form method="post" action="/runs/{place}/replay"><button class="button quiet" title="Simulate it again and compare every bit">
Replay</button></form>
<details class="pop" name="pop"><summary class="button quiet">Export</summary>
<form action="/runs/{place}/export">
<label>As <select name="format">{formats}</select></label>
<label>From t, in s ({span}); empty: all <input type="number" name="start" step="any" inputmode="decimal"
placeholder="{begin}"></label>
<label>To t, in s <input type="number" name="end" step="any" inputmode="decimal" placeholder="{end}"></label>
<p class="hint">The download begins when the file is ready.</p>
<button class="button">Export</button>
</form></details>
<a class="button quiet" href="/runs/{place}.rrd" download>Download</a>
{details}
<details class="pop right" name="pop"><summary class="button quiet">Note and tags</summary>
<form method="post" action="/runs/{place}/notes">
<label>Note <textarea name="note" rows="3" maxlength="2000">{note}</textarea></label>
<label>Tags, separated by commas <input name="tags" value="{tags}" maxlength="200"></label>
<label class="check"><input type="checkbox" name="keep"{kept}> Keep: never delete this run</label>
<button class="button">Save</button>
</form></details>
<a class="button quiet danger" href="/runs/{place}/delete">Delete</a>
</div>
</div>
<p class="hint" id="replay" role="status" data-address="/runs/{place}/replay" data-working="{working}"
data-kind="{finding}">{sentence}</p>
{hint}
<noscript><p>Rerun's viewer needs JavaScript.</p></noscript>
<iframe id="viewer" title="The recording in rerun's viewer" data-recording="{address}" allowfullscreen></iframe>
"""
DETAILS = """<details class="pop right" name="pop"><summary class="button quiet">Metrics and changes</summary>
<div class="details"><dl>{metrics}</dl><ul>{changes}</ul></div></details>"""
UNSHOWN = """<a class="button" href="/runs">All runs</a> {download}
<a class="button quiet danger" href="/runs/{place}/delete">Delete</a>"""
DOWNLOAD = """<a class="button quiet" href="/runs/{place}.rrd" download>Download it as it is</a>"""
LIVE_HINT = Markup(
    '<p class="hint">This run is still being recorded: you see it up to this moment. Reload to see more.</p>'
)
ASK = """<section class="message"><h1>Delete this run?</h1>
<p><b>{preset}</b>, {started}, {duration}, {size}. This cannot be undone.</p>
<form method="post" action="/runs/{place}/delete" class="actions">
<button class="button danger">Delete</button> <a class="button quiet" href="/runs">Keep it</a>
</form></section>"""


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
    logs = context.settings.logs
    rows = await asyncio.to_thread(list_rows, logs)
    if not rows:
        return page("Runs", fill(NO_RUNS, folder=logs, import_form=_import_form()), here="/runs", head=IMPORT_SCRIPTS)
    missing = await asyncio.to_thread(context.measuring.look, rows)
    measuring = f"{missing} of them are being measured: reload to see more." if missing else ""
    total = size_text(sum(row.size for row in rows))
    body = fill(
        LIBRARY,
        count=len(rows),
        total=total,
        folder=logs,
        measuring=measuring,
        most=MOST_RUNS,
        import_form=_import_form(),
        table=runs_table(rows),
    )
    return page("Runs", body, here="/runs", kind="wide", head=LIBRARY_SCRIPTS)


def _import_form() -> Markup:
    return fill(IMPORT, endings=", ".join(IMPORTED), largest=LARGEST_UPLOAD, size=size_text(LARGEST_UPLOAD))


def _no_such_run(error: RecordingError) -> web.Response:
    return message("No such run", str(error), 404, Markup('<a class="button" href="/runs">All runs</a>'))


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
        more = fill(UNSHOWN, place=row.address, download="" if row.problem else fill(DOWNLOAD, place=row.address))
        return message("This run cannot be shown", str(error), 422, more)
    body = _review_body(row, recording_address(context_of(request), row.id), context_of(request).replays.state(row))
    return page(f"{row.preset} {row.started:%H:%M:%S}", body, here="/runs", kind="review", head=REVIEW_SCRIPTS)


def _review_body(row: RunRow, address: str, replay: ReplayState | None) -> Markup:
    end = f"{row.begins + row.duration:.10g}" if row.duration is not None else ""
    return fill(
        REVIEW,
        place=row.address,
        address=address,
        preset=row.preset,
        started=f"{row.started:%Y-%m-%d %H:%M:%S}",
        duration=duration_text(row.duration),
        size=size_text(row.size),
        kind=row.state.replace(" ", "-"),
        state=state_word(row),
        details=_details(row),
        tag_list=join(fill(' <span class="tag">{tag}</span>', tag=tag) for tag in row.tags),
        begin=f"{row.begins:.10g}",
        end=end,
        span=f"{row.begins:.10g} to {end}" if end else f"from {row.begins:.10g} on",
        formats=join(
            fill('<option value="{kind}">{words}</option>', kind=kind, words=EXPORTS[kind]) for kind in EXPORTS
        ),
        working="yes" if replay is not None and replay.working else "",
        finding=replay.kind if replay is not None else "",
        sentence=replay.sentence if replay is not None else "",
        note=row.note,
        tags=", ".join(row.tags),
        kept=Markup(" checked" if row.kept else ""),
        hint=LIVE_HINT if row.state == "in use" else Markup(""),
    )


def _details(row: RunRow) -> Markup:
    """Metrics, and what was changed against the preset."""
    if not row.metrics and not row.changes:
        return Markup("")
    metrics = join(
        fill("<dt>{name}</dt><dd>{value}</dd>", name=name, value=text)
        for name, text in noted_texts(row.metrics).items()
    )
    changes = join(fill("<li>{line}</li>", line=line) for line in row.changes)
    return fill(DETAILS, metrics=metrics, changes=changes)


async def recording(request: web.Request) -> web.StreamResponse:
    """The recording's file, in parts if asked for; the viewer loads it from here."""
    try:
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
    body = fill(
        ASK,
        place=row.address,
        preset=row.preset,
        started=f"{row.started:%Y-%m-%d %H:%M:%S}",
        duration=duration_text(row.duration),
        size=size_text(row.size),
    )
    return page("Delete?", body, here="/runs")


async def delete(request: web.Request) -> web.Response:
    """Delete a run."""
    row = await row_of(request)
    await asyncio.to_thread(delete_run, row)
    raise web.HTTPSeeOther("/runs")
