"""What can be done with many runs at once: tag them, have them as one archive, delete them."""

import asyncio

from aiohttp import web

from flexlab.errors import FlexlabError, RecordingError
from flexlab.plain_text import shown
from flexlab.recording.store.run_index import (
    RunRow,
    annotate_run,
    check_removable,
    delete_run,
    size_text,
)
from flexlab.server.pages.layout import message, page
from flexlab.server.pages.page_context import context_of
from flexlab.server.pages.run_actions import TABLES, claim_room, file_on_its_way, send_download, table_size
from flexlab.server.pages.templating import button
from flexlab.server.run_jobs import archive_into
from flexlab.server.visitors import asker_of, run_for

MOST_RUNS = 500
"""Runs at once: as many names as a form may hold."""
LARGEST_ARCHIVE = 4_000_000_000
"""Bytes of recordings in one archive."""
RECORDINGS = "rrd"
FORMATS = (RECORDINGS, *TABLES)
"""What the runs of an archive can be had as."""
ALL_RUNS = button("/runs", "All runs")


def add_bulk_actions(router: web.UrlDispatcher) -> None:
    """Routes of actions on many runs."""
    router.add_post("/runs/tag", tag)
    router.add_post("/runs/export", export)
    router.add_post("/runs/delete", delete)


async def _chosen(request: web.Request) -> list[RunRow]:
    """The runs that the form names. Raises `RecordingError` if it names none, too many, or one that is not the visitor's."""
    names = list(dict.fromkeys(map(str, (await request.post()).getall("run", []))))
    if not 1 <= len(names) <= MOST_RUNS:
        raise RecordingError(f"{len(names)} runs were chosen: choose 1 to {MOST_RUNS} in the table.")
    return [await run_for(request, name) for name in names]


async def tag(request: web.Request) -> web.StreamResponse:
    """Add tags to runs."""
    tags = str((await request.post()).get("tags", ""))
    if not tags.strip(" ,"):
        raise RecordingError("No tag was given: write one or more, separated by commas.")
    for row in await _chosen(request):
        await asyncio.to_thread(annotate_run, row, row.note, ",".join((*row.tags, tags)), row.kept)
    raise web.HTTPSeeOther("/runs")


async def export(request: web.Request) -> web.StreamResponse:
    """Runs as one archive, each as it was recorded or as a table."""
    kind, rows, context = str((await request.post()).get("format", "")), await _chosen(request), context_of(request)
    if kind not in FORMATS:
        raise RecordingError(f"format = {shown(kind)} is not known: choose one of {', '.join(FORMATS)}.")
    size = sum(row.size for row in rows)
    if size > LARGEST_ARCHIVE:
        raise RecordingError(
            f"These runs have {size_text(size)}: at most {size_text(LARGEST_ARCHIVE)} fit. Choose fewer."
        )
    if odd := next((row.problem for row in rows if row.problem), ""):
        raise RecordingError(odd)
    try:
        async with file_on_its_way(request) as folder:
            await claim_room(request, folder, sum(table_size(row, kind) for row in rows))
            archive = await context.tasks.run(
                asker_of(request), archive_into, tuple(row.path for row in rows), kind, folder
            )
            return await send_download(request, archive)
    except FlexlabError as error:
        return message("Nothing was exported", str(error), 422, ALL_RUNS)


async def delete(request: web.Request) -> web.StreamResponse:
    """Ask, and delete runs when the answer is yes; what may not go stays, and is named."""
    rows, sure = await _chosen(request), (await request.post()).get("sure") == "yes"
    stay: dict[str, str] = {}
    for row in rows:
        try:
            if sure:
                await asyncio.to_thread(delete_run, row)
            else:
                check_removable(row)
        except RecordingError as error:
            stay[row.id] = str(error)
    going = [row for row in rows if row.id not in stay]
    if not sure:
        return page("delete_many.html", "Delete?", here="/runs", going=going, stay=list(stay.values()))
    if stay:
        gone = f"{len(going)} of {len(rows)} runs were deleted."
        return message("Some runs stay", "\n".join((gone, *stay.values())), 409, ALL_RUNS)
    raise web.HTTPSeeOther("/runs")
