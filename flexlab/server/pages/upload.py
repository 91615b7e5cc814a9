"""`/runs/import`: takes an exported run, or a recording from elsewhere, into the library."""

import asyncio
import warnings
from pathlib import Path

from aiohttp import BadContentDispositionHeader, BadContentDispositionParam, BodyPartReader, web

from flexlab.errors import FlexlabError, RecordingError
from flexlab.plain_text import visible
from flexlab.recording.importing import IMPORTED
from flexlab.recording.store.run_files import file_word
from flexlab.recording.store.run_index import size_text
from flexlab.server.pages.layout import message
from flexlab.server.pages.page_context import context_of
from flexlab.server.pages.run_actions import claim_room, file_on_its_way
from flexlab.server.pages.templating import button
from flexlab.server.run_jobs import take_in
from flexlab.server.visitors import asker_of, is_teacher, visitor_of

LARGEST_UPLOAD = 1_000_000_000
"""Bytes: half an hour of a run."""
PIECE = 256 * 1024
"""Bytes read at once."""
UPLOAD_TIME = 900.0
"""s that an upload may take: the largest one over a line of 10 Mbit/s."""
MOST_PARTS = 8
"""Of an upload: its form has one."""
MULTIPART = "multipart/form-data"
ALL_RUNS = button("/runs", "All runs")

TOO_LARGE = (
    f"This file is larger than {size_text(LARGEST_UPLOAD)}: export a shorter range of time, "
    "or put a recording (.rrd) into the logs folder yourself."
)


# aiohttp would write odd names of files to the terminal as they come.
warnings.filterwarnings("ignore", category=BadContentDispositionHeader)
warnings.filterwarnings("ignore", category=BadContentDispositionParam)


def add_upload(router: web.UrlDispatcher) -> None:
    """Route of the upload."""
    router.add_post("/runs/import", upload)


async def upload(request: web.Request) -> web.StreamResponse:
    """Take one file; its run's page follows."""
    context = context_of(request)
    asker = asker_of(request)
    try:
        async with file_on_its_way(request) as folder:
            path = await _receive(request, folder)
            run = await context.tasks.run(asker, take_in, path, context.settings.logs, *_owner(request))
    except FlexlabError as error:
        return message("Nothing was imported", str(error), 422, ALL_RUNS)
    raise web.HTTPSeeOther(f"/runs/{run}")


def _owner(request: web.Request) -> tuple[dict[str, str], float | None]:
    """(notes of whose the run is: the visitor's, where each has their own; bytes that all of theirs may take)."""
    visitor = visitor_of(request)
    if is_teacher(request) or not context_of(request).places.is_private:
        return {}, None
    notes = {"owner": visitor.owner, "visitor": visitor.name}
    return notes, context_of(request).settings.most_bytes_per_visitor


async def _receive(request: web.Request, folder: Path) -> Path:
    """The uploaded file in `folder`, under its own name. Raises `RecordingError`."""
    if request.content_type != MULTIPART:
        raise RecordingError("There is no file in this upload: choose one first.")
    if request.content_length is None:
        raise RecordingError("This upload does not say how large it is: send it with a Content-Length.")
    if request.content_length > LARGEST_UPLOAD + PIECE:
        raise RecordingError(TOO_LARGE)
    await claim_room(request, folder, request.content_length)
    try:
        async with asyncio.timeout(UPLOAD_TIME):
            parts = await request.multipart()
            for _ in range(MOST_PARTS):
                part = await parts.next()
                if part is None:
                    break
                if isinstance(part, BodyPartReader) and part.name == "file" and part.filename:
                    return await _keep(part, folder)
    except TimeoutError:
        raise RecordingError(
            f"This upload took longer than {UPLOAD_TIME / 60:g} minutes: export a shorter range of time."
        ) from None
    except (ValueError, AssertionError, RuntimeError):  # Too deep is a RuntimeError too.
        raise RecordingError("This upload is malformed: choose the file again.") from None
    raise RecordingError("There is no file in this upload: choose one first.")


async def _keep(part: BodyPartReader, folder: Path) -> Path:
    given = Path((part.filename or "").replace("\\", "/"))
    if given.suffix.lower() not in IMPORTED:
        raise RecordingError(
            f"{visible(given.name, 60)} has no known format: choose a file that ends in {', '.join(IMPORTED)}."
        )
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
