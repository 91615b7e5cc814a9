"""`/runs`: the library and its imports. `/runs/<id>`: a run in rerun's viewer, its file and its notes."""

import asyncio
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aiohttp import BadContentDispositionHeader, BadContentDispositionParam, BodyPartReader, hdrs, web

from flexlab.analysis.metrics import METRICS
from flexlab.analysis.metrics.run_metrics import noted_text, noted_texts, noted_value
from flexlab.errors import FlexlabError, RecordingError
from flexlab.recording.importing import IMPORTED, check_format
from flexlab.recording.overlay import MOST_RUNS
from flexlab.recording.repair import finish
from flexlab.recording.store.run_files import SUFFIX, file_word, unreadable
from flexlab.recording.store.run_index import RunRow, annotate_run, find_row, size_text
from flexlab.recording.viewer import VIEWER_FILES, viewer_folder
from flexlab.scenario.field_text import change_in_words
from flexlab.server.auth import NO_COOKIE, WITH_A_PASS, has_pass, recording_address
from flexlab.server.labs.recorded_lab import little_space
from flexlab.server.pages import ALL_RUNS, message, page, part
from flexlab.server.pages.run_actions import EXPORTS, TABLES, file_on_its_way, row_of
from flexlab.server.run_jobs import replay_of, take_in
from flexlab.server.task_book import IDLE
from flexlab.server.visitors import (
    context_of,
    file_answer,
    form_of,
    runs_for,
    visitor_of,
    with_names,
)

ROUTES = web.RouteTableDef()
VIEWER_POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; connect-src 'self' data: blob:; "
    "object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""The viewer may connect to this address only: by itself it would fetch fonts, look for updates and report its use."""
FETCHING = '<script src="../static/fetch_recordings.js"></script>'
"""The script through which the viewer requests recordings."""
NO_FILE_NAME = r"[^\w.-]+"
"""Characters that are replaced in the name of a downloaded recording."""


@dataclass(frozen=True)
class TableColumn:
    """The head of a column. `kind`: how it is sorted."""

    name: str
    kind: str
    title: str
    unit: str = ""


_FIRST = ("Started", "time"), ("Preset", "text"), ("Duration", "number"), ("Size", "number"), ("State", "text")
COLUMNS = tuple(TableColumn(name, kind, name) for name, kind in _FIRST)
METRIC_COLUMNS = [column for metric in METRICS.values() for column in metric.columns if column.listed]
"""The metrics in the table; a run's own page shows all."""
LAST_COLUMNS = (
    TableColumn("Note, changes", "text", "Note, and what was changed against the preset"),
    TableColumn("", "text", ""),
)
CHANGES_SHOWN = 3
"""Most changes of a run shown in the table."""


def table_values(rows: Sequence[RunRow], short: bool = False) -> dict[str, Any]:
    """The values of `runs_table.html`; the short table has no metrics, notes or actions."""
    metrics = (
        TableColumn(c.heading[0].upper() + c.heading[1:], "number", c.label, f"({c.unit})") for c in METRIC_COLUMNS
    )
    return {
        "rows": rows,
        "short": short,
        "columns": COLUMNS if short else (*COLUMNS, *metrics, *LAST_COLUMNS),
        "metric_columns": METRIC_COLUMNS,
        "noted_text": noted_text,
        "noted_value": noted_value,
        "changes_told": _changes_told,
    }


def _changes_told(row: RunRow) -> list[str]:
    left = len(row.changes) - CHANGES_SHOWN
    return [*map(change_in_words, row.changes[:CHANGES_SHOWN]), *([f"{left} more"] if left > 0 else [])]


LARGEST_UPLOAD = 1_000_000_000
"""Largest upload, bytes: half an hour of a run."""
PIECE = 256 * 1024
"""Bytes read at a time."""
UPLOAD_TIME = 900.0
"""Most seconds of an upload: enough for the largest one at 10 Mbit/s."""
MOST_PARTS = 8
"""Most parts of an upload that are read; the form has one."""
MULTIPART = "multipart/form-data"

TOO_LARGE = (
    f"This file is larger than {size_text(LARGEST_UPLOAD)}: export a shorter range of time, "
    "or put a recording (.rrd) into the logs folder yourself."
)


# aiohttp would print odd file names to the terminal unchanged.
warnings.filterwarnings("ignore", category=BadContentDispositionHeader)
warnings.filterwarnings("ignore", category=BadContentDispositionParam)


@ROUTES.post("/runs/import")
async def upload(request: web.Request) -> web.StreamResponse:
    """Import one file, then redirect to its run's page."""
    context, visitor = context_of(request), visitor_of(request)
    # Where visitors have their own runs, this one is marked as the visitor's and counts towards their quota.
    owned = context.places.is_private and not visitor.is_teacher
    notes = {"owner": visitor.owner, "visitor": visitor.name} if owned else {}
    quota = context.settings.bytes_of_visitor if owned else None
    try:
        if owned and not visitor.id:  # A new one with each import would have a new quota.
            raise RecordingError(f"Open the page Runs again, and import the file there.{NO_COOKIE}")
        async with file_on_its_way(request, _size_of_upload(request)) as folder:
            path = await _receive(request, folder)
            run = await context.tasks.run(visitor, take_in, path, context.settings.logs, notes, quota)
    except FlexlabError as error:
        return message("Nothing was imported", str(error), 422, ALL_RUNS)
    raise web.HTTPSeeOther(f"/runs/{run}")


def _size_of_upload(request: web.Request) -> int:
    """The bytes of an upload. Raises `RecordingError` for one that cannot be taken."""
    if request.content_type != MULTIPART:
        raise RecordingError("There is no file in this upload: choose one first.")
    if request.content_length is None:
        raise RecordingError("This upload does not say how large it is: send it with a Content-Length.")
    if request.content_length > LARGEST_UPLOAD + PIECE:
        raise RecordingError(TOO_LARGE)
    return request.content_length


async def _receive(request: web.Request, folder: Path) -> Path:
    """Store the uploaded file in `folder` under its own name and return it. Raises `RecordingError`."""
    kept: Path | None = None
    try:
        async with asyncio.timeout(UPLOAD_TIME):
            parts = await request.multipart()
            for _ in range(MOST_PARTS):
                part = await parts.next()
                if part is None:
                    break
                if isinstance(part, BodyPartReader) and part.name == "file" and part.filename:
                    if kept is not None:
                        raise RecordingError("This upload has more than one file: choose one.")
                    kept = await _keep(part, folder)
    except TimeoutError:
        raise RecordingError(
            f"This upload took longer than {UPLOAD_TIME / 60:g} minutes: export a shorter range of time."
        ) from None
    except (ValueError, AssertionError, RuntimeError):  # Parts nested too deeply raise RuntimeError.
        raise RecordingError("This upload is malformed: choose the file again.") from None
    if kept is None:
        raise RecordingError("There is no file in this upload: choose one first.")
    return kept


async def _keep(part: BodyPartReader, folder: Path) -> Path:
    given = Path((part.filename or "").replace("\\", "/"))
    check_format(given.name)
    path = folder / (file_word(given.stem) + given.suffix.lower())
    size = 0
    try:
        with path.open("wb") as file:
            while piece := await part.read_chunk(PIECE):
                size += len(piece)
                if size > LARGEST_UPLOAD:
                    raise RecordingError(TOO_LARGE)
                await asyncio.to_thread(file.write, piece)
    except OSError as error:
        raise RecordingError(f"The upload cannot be stored ({error.strerror}): make room on the disk.") from None
    return path


@ROUTES.get("/runs")
@ROUTES.get("/runs/")
async def library(request: web.Request) -> web.Response:
    """The table of all runs."""
    context = context_of(request)
    rows = await runs_for(request)
    return await asyncio.to_thread(  # Thousands of runs take seconds, in which the others are served.
        page,
        "library.html",
        "Runs",
        here="/runs",
        kind="wide" if rows else "text",
        missing=context.measuring.look(rows) if rows else 0,
        folder=context.settings.logs,
        unreadable="" if rows else await asyncio.to_thread(unreadable, context.settings.logs),
        little=await asyncio.to_thread(little_space, context.settings.logs),
        tables=TABLES,
        most=MOST_RUNS,
        endings=", ".join(IMPORTED),
        largest=LARGEST_UPLOAD,
        **table_values(rows),
    )


@ROUTES.get("/runs/{run}" + SUFFIX)
@ROUTES.get(WITH_A_PASS + "{pass}/{run}" + SUFFIX)
async def recording(request: web.Request) -> web.StreamResponse:
    """The recording's file, in ranges on request; the viewer loads it from here."""
    if request.path.startswith(WITH_A_PASS) and has_pass(request):
        # Only those who may see the run get its pass; rerun's viewer does not say who asks.
        row = await asyncio.to_thread(find_row, context_of(request).settings.logs, request.match_info["run"])
    else:
        row = await row_of(request)
    if row.problem:
        return message("No such run", row.problem, 404, ALL_RUNS)
    return file_answer(row.path, re.sub(NO_FILE_NAME, "-", row.id) + SUFFIX)


@ROUTES.get("/runs/{run}")
async def review(request: web.Request) -> web.Response:
    """One run in the viewer; its file is finished first if its writer died."""
    row = await row_of(request)
    try:
        if row.problem:
            raise RecordingError(row.problem)
        if row.state == "unfinished":
            await asyncio.to_thread(finish, row.path)
            row = await row_of(request)
    except RecordingError as error:
        return message("This run cannot be shown", str(error), 422, part("unshown", row))
    [row] = await with_names(request, [row])
    end = f"{row.begins + row.duration:.10g}" if row.duration is not None else ""
    return page(
        "review.html",
        f"{row.preset} {row.started:%H:%M:%S}",
        here="/runs",
        kind="review",
        row=row,
        address=recording_address(context_of(request), row.id),
        replay=replay_of(context_of(request).replays, row) or IDLE,
        begin=f"{row.begins:.10g}",
        end=end,
        span=f"{row.begins:.10g} to {end}" if end else f"from {row.begins:.10g} on",
        exports=EXPORTS,
        noted_texts=noted_texts,
        changes=[change_in_words(change) for change in row.changes],
    )


@ROUTES.get("/viewer/{name:[^/]*}")
async def viewer(request: web.Request) -> web.StreamResponse:
    """One of the three files of rerun's viewer."""
    name = request.match_info["name"] or "index.html"
    if name not in VIEWER_FILES:
        raise web.HTTPNotFound
    folder = await asyncio.to_thread(viewer_folder)
    headers = {
        hdrs.CONTENT_TYPE: VIEWER_FILES[name],
        hdrs.CACHE_CONTROL: "no-cache",
        "Content-Security-Policy": VIEWER_POLICY,
    }
    if name == "index.html":
        text = await asyncio.to_thread((folder / name).read_text, "utf-8")
        return web.Response(text=text.replace("<head>", "<head>" + FETCHING, 1), headers=headers)
    return web.FileResponse(folder / name, headers=headers)


@ROUTES.post("/runs/{run}/notes")
async def save_notes(request: web.Request) -> web.Response:
    """Save what was changed of a run's note, its tags, and whether to keep it."""
    row, form = await row_of(request), await form_of(request)

    def changed(name: str) -> str | None:
        """What was typed; None for what the page showed, which somebody may have changed meanwhile, or if nothing is sent."""
        typed, before = (str(form.get(key, "")).replace("\r\n", "\n") for key in (name, f"shown-{name}"))
        return None if typed == before and (f"shown-{name}" in form or name not in form) else typed

    kept = changed("keep")
    await asyncio.to_thread(annotate_run, row, changed("note"), changed("tags"), None if kept is None else bool(kept))
    raise web.HTTPSeeOther(f"/runs/{row.address}")
