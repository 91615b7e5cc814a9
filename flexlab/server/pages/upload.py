"""`/runs/import`: takes an exported run, or a recording from elsewhere, into the library."""

import asyncio
import shutil
import tempfile
from pathlib import Path

from aiohttp import BodyPartReader, web

from flexlab.errors import FlexlabError, RecordingError
from flexlab.recording.importing import IMPORTED
from flexlab.recording.store.run_files import file_word
from flexlab.recording.store.run_index import size_text
from flexlab.server.pages.layout import message
from flexlab.server.pages.page_context import context_of
from flexlab.server.pages.templating import button
from flexlab.server.run_jobs import take_in
from flexlab.server.visitors import is_teacher, visitor_of

LARGEST_UPLOAD = 1_000_000_000
"""Bytes: half an hour of a run."""
PIECE = 256 * 1024
"""Bytes read at once."""
MULTIPART = "multipart/form-data"
ALL_RUNS = button("/runs", "All runs")

TOO_LARGE = (
    f"This file is larger than {size_text(LARGEST_UPLOAD)}: export a shorter range of time, "
    "or put a recording (.rrd) into the logs folder yourself."
)


def add_upload(router: web.UrlDispatcher) -> None:
    """Route of the upload."""
    router.add_post("/runs/import", upload)


async def upload(request: web.Request) -> web.StreamResponse:
    """Take one file; its run's page follows."""
    context = context_of(request)
    folder = Path(await asyncio.to_thread(tempfile.mkdtemp, prefix="upload-", dir=context.workshop))
    try:
        path = await _receive(request, folder)
        run = await context.jobs.run(take_in, path, context.settings.logs, _begin_notes(request))
    except FlexlabError as error:
        return message("Nothing was imported", str(error), 422, ALL_RUNS)
    finally:
        await asyncio.shield(asyncio.to_thread(shutil.rmtree, folder, ignore_errors=True))
    raise web.HTTPSeeOther(f"/runs/{run}")


def _begin_notes(request: web.Request) -> dict[str, str]:
    """Whose the run is: the visitor's, where each has their own."""
    visitor = visitor_of(request)
    if is_teacher(request) or not context_of(request).places.is_private:
        return {}
    return {"owner": visitor.owner, "visitor": visitor.name}


async def _receive(request: web.Request, folder: Path) -> Path:
    """The uploaded file in `folder`, under its own name. Raises `RecordingError`."""
    if request.content_type != MULTIPART:
        raise RecordingError("There is no file in this upload: choose one first.")
    if (request.content_length or 0) > LARGEST_UPLOAD + PIECE:
        raise RecordingError(TOO_LARGE)
    try:
        async for part in await request.multipart():
            if isinstance(part, BodyPartReader) and part.name == "file" and part.filename:
                return await _keep(part, folder)
    except (ValueError, AssertionError):
        raise RecordingError("This upload is malformed: choose the file again.") from None
    raise RecordingError("There is no file in this upload: choose one first.")


async def _keep(part: BodyPartReader, folder: Path) -> Path:
    given = Path((part.filename or "").replace("\\", "/"))
    if given.suffix.lower() not in IMPORTED:
        raise RecordingError(
            f"{given.name[:60]} has no known format: choose a file that ends in {', '.join(IMPORTED)}."
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
