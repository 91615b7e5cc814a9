"""Actions on recorded runs: replay one, continue it, export it; tag, export or delete many at once."""

import asyncio
import contextlib
import math
import os
import shutil
import tempfile
from collections.abc import AsyncGenerator, Callable, Mapping
from dataclasses import replace
from pathlib import Path

from aiohttp import hdrs, web
from markupsafe import Markup

from flexlab.errors import FlexlabError, LabError, RecordingError
from flexlab.guide import begun
from flexlab.recording.store.run_index import LONGEST_TAGS, RunRow, annotate_run, check_removable, delete_run, size_text
from flexlab.server.auth import is_opened_by_person, refuse
from flexlab.server.pages import ALL_RUNS, message, page
from flexlab.server.pages.lab_pages import enter_lab
from flexlab.server.run_jobs import archive_into, begin_replay, choice_at, export_into, replay_of
from flexlab.server.visitors import as_download, context_of, form_of, runs_named, told, visitor_of, with_names
from flexlab.text import limited, shown, typed_number

ROUTES = web.RouteTableDef()

TABLES = {"csv": "CSV: a table as text", "parquet": "Parquet: a compressed table", "npz": "NPZ: NumPy arrays"}
FIGURES = {"png": "Figures 2–5 as PNG", "svg": "Figures 2–5 as SVG"}
WHOLE = {
    "html": "Lab sheet: one animated page with guesses, metrics, notes",
    "zip": "Archive that others can verify",
}
EXPORTS = WHOLE | TABLES | FIGURES
"""Format of an export → its description."""
PIECE = 1024 * 1024
"""Bytes sent at a time."""
KEPT_FREE = 200_000_000
"""Disk space that uploads and archives leave free, bytes."""
READING_TIME, DOWNLOAD_TIME = 30.0, 3600.0
"""Most seconds that the receiver may take for one piece and for all (the largest archive at 10 Mbit/s): until then the file
takes disk space."""
LARGEST_SHARE = {"csv": 4.0, "parquet": 1.5, "npz": 1.5, "zip": 3.0}
"""Most bytes of an export per byte of its recording."""
BACK = Markup('<a class="button" href="/runs/{}">Back to the run</a> <a class="button quiet" href="/runs">All runs</a>')

log = limited(__name__)
MOST_RUNS = 500
"""Most runs at once: as many names as a form may hold."""
LARGEST_ARCHIVE = 4_000_000_000
"""Most bytes of recordings in one archive."""
RECORDINGS = "rrd"
FORMATS = (RECORDINGS, *TABLES)
"""Formats of the runs in an archive."""


async def row_of(request: web.Request) -> RunRow:
    """The run that the address names, or the row of an unreadable file in its place. Raises `NoSuchRun`."""
    [row] = await runs_named(request, [request.match_info["run"]])
    return row


async def recorded_row_of(request: web.Request) -> RunRow:
    """The run that the address names. Raises `RecordingError` if there is none or the file is not a recording."""
    row = await row_of(request)
    if row.problem:
        raise RecordingError(row.problem)
    return row


def _problem(title: str, row: RunRow, error: FlexlabError) -> web.Response:
    return message(title, str(error), 422, BACK.format(row.address))


@ROUTES.post("/runs/{run}/replay")
async def start_replay(request: web.Request) -> web.Response:
    """Start simulating the run again; the run's page shows the progress."""
    row = await recorded_row_of(request)
    begin_replay(context_of(request).replays, visitor_of(request), row)
    raise web.HTTPSeeOther(f"/runs/{row.address}")


@ROUTES.get("/runs/{run}/replay")
async def replay_state(request: web.Request) -> web.Response:
    """The state of the run's replay, for the script in its page."""
    task = replay_of(context_of(request).replays, await row_of(request))
    if task is None:
        raise web.HTTPNotFound
    return told(task)


@ROUTES.post("/runs/{run}/continue")
async def resume(request: web.Request) -> web.StreamResponse:
    """Open the lab at an instant of the run, in exactly the recorded state."""
    row = await recorded_row_of(request)
    try:
        time = read_time("time", (await form_of(request)).get("time"))
        choice = await context_of(request).tasks.run(visitor_of(request), choice_at, row.path, time)
    except FlexlabError as error:
        return _problem("The lab cannot continue from there", row, error)
    return await enter_lab(request, choice)


@ROUTES.get("/runs/{run}/export")
async def export(request: web.Request) -> web.StreamResponse:
    """The run, or a range of its time, as a file for other programs."""
    if not is_opened_by_person(request):
        return refuse(request, 403, "An export must be asked for by a person, not from inside another page.")
    row, context = await recorded_row_of(request), context_of(request)
    try:
        kind = request.query.get("format", "")
        if kind not in EXPORTS:
            raise RecordingError(f"format = {shown(kind)} is not known: choose one of {', '.join(EXPORTS)}.")
        start, end = (read_time(name, request.query.get(name)) for name in ("start", "end"))
        if kind in WHOLE and (start, end) != (None, None):
            raise RecordingError("A lab sheet and an archive hold the whole run: leave both times empty.")
        async with file_on_its_way(request, table_size(row, kind)) as folder:
            row = _as_it_stands(request, row)
            file = await context.tasks.run(visitor_of(request), export_into, row, kind, start, end, folder)
            return await send_download(request, file)
    except FlexlabError as error:
        return _problem("Nothing was exported", row, error)


def _as_it_stands(request: web.Request, row: RunRow) -> RunRow:
    """The run with the lessons of the lab that is recording it, if any."""
    recorded = (lab.status() for lab in context_of(request).places.running())
    lessons = next((lab.lessons for lab in recorded if lab.recording == row.path), None)
    return row if lessons is None else replace(row, lessons=begun(lessons))


@contextlib.asynccontextmanager
async def file_on_its_way(request: web.Request, size: float) -> AsyncGenerator[Path]:
    """A folder for a file of up to `size` bytes in transfer from or to a visitor, removed at the end.

    Raises `BusyError`, or `RecordingError` if the disk has no room for it besides the other files in transfer.
    """
    context = context_of(request)
    with context.files.place(visitor_of(request)):
        folder = Path(await asyncio.to_thread(tempfile.mkdtemp, prefix="file-", dir=context.temporary_folder))
        context.claimed[folder] = int(size)
        try:
            await asyncio.to_thread(_check_room, folder, dict(context.claimed))
            yield folder
        except FlexlabError as error:
            if str(folder) not in str(error):
                raise
            # Visitors know their files by name, not the temporary folder.
            raise LabError(str(error).replace(f"{folder}{os.sep}", "")) from None
        finally:
            context.claimed.pop(folder, None)
            await asyncio.shield(asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True))


def _check_room(folder: Path, claimed: Mapping[Path, int]) -> None:
    missing = sum(max(size - _taken(other), 0) for other, size in claimed.items())
    free = shutil.disk_usage(folder).free
    if free - missing < KEPT_FREE:
        raise RecordingError(
            f"The disk of this server has {size_text(int(free))} free, too little for {size_text(claimed[folder])} besides "
            f"other files and the {size_text(KEPT_FREE)} that stay free for labs: make room on it."
        )


def _taken(folder: Path) -> int:
    """Bytes of the files in a folder."""
    with contextlib.suppress(OSError):  # It may be removed meanwhile.
        return sum(file.stat().st_size for file in folder.iterdir())
    return 0


def table_size(row: RunRow, kind: str) -> float:
    """The most bytes that a run takes in an export of this format."""
    return row.size * LARGEST_SHARE.get(kind, 1.0)


async def send_download(request: web.Request, path: Path) -> web.StreamResponse:
    """Send a whole file as a download. The file may be deleted afterwards (aiohttp's own answer opens it later).

    A visitor who reads nothing for `READING_TIME`, or not all in `DOWNLOAD_TIME`, is cut off.
    """
    answer = web.StreamResponse()
    answer.content_type = "application/octet-stream"
    answer.content_length = path.stat().st_size
    answer.headers[hdrs.CONTENT_DISPOSITION] = as_download(path.name)
    answer.headers[hdrs.CACHE_CONTROL] = "no-store"
    await answer.prepare(request)
    if request.method != "HEAD":
        with path.open("rb") as file:
            try:
                async with asyncio.timeout(DOWNLOAD_TIME):
                    while piece := await asyncio.to_thread(file.read, PIECE):
                        await asyncio.wait_for(answer.write(piece), READING_TIME)
            except TimeoutError:
                log.warning("Cut off %s, who did not read a download to its end.", request.remote)
                if request.transport is not None:
                    request.transport.abort()
                return answer
    await answer.write_eof()
    return answer


def read_time(name: str, text: object) -> float | None:
    """Read a typed time, s; None for an empty field. Raises `RecordingError` for anything but a number."""
    if not isinstance(text, str) or not text.strip():
        return None
    time = typed_number(text)
    if math.isnan(time):
        raise RecordingError(f"{name} = {shown(text.strip())} is not a time: give a number of seconds, such as 1.5.")
    return time


async def _chosen(request: web.Request) -> list[RunRow]:
    """The runs that the form or address names. Raises `RecordingError` for none or too many, `NoSuchRun` for another's."""
    given = (await form_of(request)).getall("run", []) or request.query.getall("run", [])
    names = list(dict.fromkeys(map(str, given)))
    if not 1 <= len(names) <= MOST_RUNS:
        raise RecordingError(f"{len(names)} runs were chosen: choose 1 to {MOST_RUNS} in the table.")
    return await runs_named(request, names)


@ROUTES.post("/runs/tag")
async def tag(request: web.Request) -> web.StreamResponse:
    """Add tags to runs."""
    tags = str((await form_of(request)).get("tags", ""))
    if not tags.strip(" ,"):
        raise RecordingError("No tag was given: write one or more, separated by commas.")
    tagged = [(row, ",".join((*row.tags, tags))) for row in await _chosen(request)]
    for row, words in tagged:  # Before the first one is changed.
        if len(words) > LONGEST_TAGS:
            raise RecordingError(
                f"No run was tagged: the tags of {row.id} would have {len(words)} characters, and at most {LONGEST_TAGS} fit."
            )
    for row, words in tagged:
        await asyncio.to_thread(annotate_run, row, None, words)
    raise web.HTTPSeeOther("/runs")


@ROUTES.post("/runs/export")
async def export_many(request: web.Request) -> web.StreamResponse:
    """Download runs as one archive, each as it was recorded or as a table."""
    kind, rows, context = str((await form_of(request)).get("format", "")), await _chosen(request), context_of(request)
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
        async with file_on_its_way(request, sum(table_size(row, kind) for row in rows)) as folder:
            archive = await context.tasks.run(visitor_of(request), archive_into, tuple(rows), kind, folder)
            return await send_download(request, archive)
    except FlexlabError as error:
        return message("Nothing was exported", str(error), 422, ALL_RUNS)


@ROUTES.get("/runs/delete")
@ROUTES.post("/runs/delete")
async def delete(request: web.Request) -> web.StreamResponse:
    """Ask for confirmation, then delete runs; name those that may not be deleted."""
    rows = await _chosen(request)
    if (await form_of(request)).get("sure") != "yes":
        stay = _staying(rows)
        going = await with_names(request, [row for row in rows if row.id not in stay])
        return page("delete.html", "Delete?", here="/runs", going=going, stay=list(stay.values()))
    if stay := await asyncio.to_thread(_staying, rows, delete_run):
        gone = f"{len(rows) - len(stay)} of {len(rows)} runs were deleted."
        return message("Some runs stay", "\n".join((gone, *stay.values())), 409, ALL_RUNS)
    raise web.HTTPSeeOther("/runs")


def _staying(rows: list[RunRow], remove: Callable[[RunRow], None] = check_removable) -> dict[str, str]:
    """Id of each run that may not be deleted → the sentence that says why."""
    stay: dict[str, str] = {}
    for row in rows:
        try:
            remove(row)
        except RecordingError as error:
            stay[row.id] = str(error)
    return stay
