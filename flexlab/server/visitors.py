"""Who a request comes from: the teacher or a visitor, what a visitor is called, and whose runs they may touch."""

import asyncio
import contextlib
import hmac
import os
import secrets
import unicodedata
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from urllib.parse import quote, unquote

from aiohttp import web

from flexlab.errors import LabError, RecordingError
from flexlab.recording.store.notes import is_regular
from flexlab.recording.store.run_files import list_files
from flexlab.recording.store.run_index import RunRow, find_row, no_such_run, read_rows
from flexlab.server.labs.quota import owner_word
from flexlab.server.limits import Asker, network_of
from flexlab.server.pages.page_context import Context, context_of

KEY_FILE = ".flexlab-cookie-key"
"""In the logs folder: whoever visited before a restart keeps their runs."""
KEY_BYTES = 32
VISITOR_BYTES = 18
"""Randomness of the cookie by which a visitor finds their own lab and runs again."""
COOKIE_AGE = 30 * 24 * 3600
"""s that a browser stays signed in, keeps a name, and finds its runs again."""
LONGEST_NAME = 40
"""Characters of a visitor's name: a first and a last one."""
MOST_PARTS = 4
"""Characters that a letter may be typed as: itself and its accents."""
LONGEST_COOKIE = 500
"""Characters of such a name as a cookie holds it."""
UNNAMED = ""
"""The name of who has not given one."""


@dataclass(frozen=True)
class Visitor:
    """Who has a lab."""

    id: str
    """The word of their cookie, a secret."""
    name: str = UNNAMED
    address: str = ""
    """Where they come from."""

    @property
    def owner(self) -> str:
        """By which their runs are known as theirs; empty for nobody."""
        return owner_word(self.id)


def cookie_key(logs: Path | None) -> bytes:
    """The key that signs the cookies of all servers of these logs, made if need be; without logs, a new one."""
    key = secrets.token_bytes(KEY_BYTES)
    if logs is None:
        return key
    file = logs / KEY_FILE
    draft = file.with_name(f"{KEY_FILE}-{secrets.token_hex(8)}")
    with contextlib.suppress(OSError):  # Where nothing can be written a restart signs everybody out.
        try:
            if not is_regular(file):
                with open(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as begun:
                    begun.write(key)
                with contextlib.suppress(FileExistsError):  # Another server was faster: its key holds.
                    os.link(draft, file)
        finally:
            draft.unlink(missing_ok=True)
        found = file.read_bytes() if is_regular(file) else b""
        return found if len(found) == KEY_BYTES else key
    return key


def checked_name(text: str) -> str:
    """A name as it was typed, without spaces around it. Raises `LabError` for one that no page should show."""
    # As typed, first: to put thousands of accents in order takes seconds, in which nobody else is answered.
    name = text.strip()
    name = unicodedata.normalize("NFC", name) if len(name) <= MOST_PARTS * LONGEST_NAME else name
    if len(name) > LONGEST_NAME:
        raise LabError(f"This name has {len(name)} characters: at most {LONGEST_NAME} fit. Shorten it.")
    # Category C: control characters, changes of the writing direction, surrogates, what no font has.
    if any(unicodedata.category(letter)[0] == "C" or letter in "\u2028\u2029" for letter in name):
        raise LabError("This name holds control characters: type it with letters, digits and spaces.")
    return name


def visitor_of(request: web.Request) -> Visitor:
    """Who asks; without an id if their browser has none yet."""
    context = context_of(request)
    try:
        given = request.cookies.get(context.name_cookie, "")[:LONGEST_COOKIE]
        name = checked_name(unquote(given, errors="strict"))
    except (LabError, UnicodeDecodeError):
        name = UNNAMED
    return Visitor(
        _issued(context, request.cookies.get(context.visitor_cookie, "")), name, network_of(request.remote or "")
    )


def _issued(context: Context, given: str) -> str:
    """A visitor's id if this server gave it; else none: a made-up one would be a new visitor at every request."""
    word, _, signature = given.rpartition(".")
    wanted = context.signed("visitor", word)
    return given if hmac.compare_digest(signature.encode("utf-8", "replace"), wanted.encode()) else ""


def asker_of(request: web.Request) -> Asker:
    """Who asks, as limits know them."""
    visitor = visitor_of(request)
    return Asker(visitor.id, visitor.address, is_teacher(request))


def known_visitor_of(request: web.Request) -> Visitor:
    """Who asks, with an id made up for who has none; `keep_visitor` lets their browser keep it."""
    visitor = visitor_of(request)
    if visitor.id:
        return visitor
    word = secrets.token_urlsafe(VISITOR_BYTES)
    signature = context_of(request).signed("visitor", word)
    return Visitor(f"{word}.{signature}", visitor.name, visitor.address)


@web.middleware
async def greet(
    request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
) -> web.StreamResponse:
    """Give whoever sees a first page a cookie, so that many at one address are not one person."""
    answer = await handler(request)
    first = answer.status == 200 and answer.content_type == "text/html" and not answer.prepared
    known = is_teacher(request) or visitor_of(request).id or context_of(request).visitor_cookie in answer.cookies
    if first and not known:
        keep_visitor(request, answer, known_visitor_of(request))
    return answer


def keep_visitor(request: web.Request, answer: web.StreamResponse, visitor: Visitor) -> None:
    """Let a visitor's browser keep who they are."""
    context = context_of(request)
    # Lax, not strict: whoever follows a link from elsewhere should find their lab too.
    answer.set_cookie(context.visitor_cookie, visitor.id, max_age=COOKIE_AGE, httponly=True, samesite="Lax", path="/")
    if visitor.name != visitor_of(request).name:
        answer.set_cookie(
            context.name_cookie,
            quote(visitor.name, safe=""),
            max_age=COOKIE_AGE,
            httponly=True,
            samesite="Lax",
            path="/",
        )


def is_teacher(request: web.Request) -> bool:
    """Whether who asks may do everything: with the teacher's token, or where there is none."""
    context = context_of(request)
    if context.teacher_token is None:
        return True
    return has_teacher_cookie(request)


def has_teacher_cookie(request: web.Request) -> bool:
    """Whether who asks has shown the teacher's token or, where there is none, opened the teacher's page."""
    context = context_of(request)
    given = request.cookies.get(context.teacher_cookie, "")
    wanted = context.signed("teacher", context.teacher_token)
    return hmac.compare_digest(given.encode("utf-8", "replace"), wanted.encode())


def has_class(request: web.Request) -> bool:
    """Whether who asks has labs of others to look after."""
    context = context_of(request)
    return is_teacher(request) and (context.places.is_private or not context.settings.is_local)


def may_touch(request: web.Request, row: RunRow) -> bool:
    """Whether a run is for who asks: their own; all runs for the teacher. What a shared lab recorded is everybody's."""
    if is_teacher(request):
        return True
    if row.owner:
        return hmac.compare_digest(row.owner.encode(), visitor_of(request).owner.encode())
    return not context_of(request).places.is_private


async def runs_for(request: web.Request, most: int | None = None) -> list[RunRow]:
    """The runs that who asks may see, newest first, or the newest `most`."""
    logs = context_of(request).settings.logs

    def found() -> Iterator[RunRow]:
        return (row for row in read_rows(list_files(logs)) if may_touch(request, row))

    return await asyncio.to_thread(lambda: list(islice(found(), most)))


async def run_for(request: web.Request, run: str) -> RunRow:
    """One of the runs that who asks may see. Raises `RecordingError`: whose run it is, or that there is one, is not told."""
    context: Context = context_of(request)
    logs: Path = context.settings.logs
    row = await asyncio.to_thread(find_row, logs, run)
    if not may_touch(request, row):
        raise RecordingError(no_such_run(run))
    return row
