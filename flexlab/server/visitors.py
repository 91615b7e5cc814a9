"""The server that a request reached, its sender (the teacher or a visitor), and the runs that the sender may see."""

import asyncio
import contextlib
import hmac
import os
import re
import secrets
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from email.message import Message
from itertools import islice
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote, unquote

import aiohttp
from aiohttp import hdrs, web

from flexlab.errors import LabError
from flexlab.files import is_regular
from flexlab.recording.store.people import owner_of
from flexlab.recording.store.run_files import list_files
from flexlab.recording.store.run_index import NoSuchRun, RunRow, find_rows, read_rows, told_apart
from flexlab.server.connections import Handler
from flexlab.server.labs import LabProvider
from flexlab.server.limits import Guesses, Limit, Visitor, network_of
from flexlab.server.preset_cards import PresetCards
from flexlab.server.run_jobs import MOST_COMPARISONS, MOST_REPLAYS, Measuring
from flexlab.server.settings import Settings, secret_word
from flexlab.server.studies import MOST_AT_ONCE, MOST_STUDIES
from flexlab.server.task_book import IDLE, Task, TaskBook
from flexlab.server.tasks import Tasks
from flexlab.text import visible

MOST_PAGES = 12, 120, 128, 8
"""Most open pages of labs: of one visitor, one address and all, and extra for the teacher."""
MOST_VIEWERS = 4, 40, 48, 4
"""Most viewers of live data: each takes as much bandwidth as a film, and a class behind one address has one each."""
MOST_FILES = 2, 30, 40, 4
"""Most files in transfer: a class behind one address asks for one each at once. `claimed` bounds their bytes."""
MOST_BOARDS = 4
"""Most tasks of the leaderboard that a server keeps: the newest computation and the figures of the newest tables."""
SIGNATURE = 40
"""Hexadecimal digits of a signature in a cookie."""
KEY_FILE = ".flexlab-cookie-key"
"""File of the cookies' key in the logs folder, so that visitors keep their runs when the server starts again."""
KEY_BYTES = 32
COOKIE_AGE = 30 * 24 * 3600
"""Seconds for which a browser stays signed in, keeps a name, and finds its runs again."""
LONGEST_NAME = 40
"""Most characters of a visitor's name, first and last name together."""
MOST_PARTS = 4
"""Most characters typed for one letter: itself and its accents."""
SEVERAL = re.compile(r"run|words\d")
"""Fields of which a form or an address may have several: chosen runs, and a study's ticked options."""
LONGEST_FIELD = 40
"""Most characters of a field's name quoted in a sentence."""
LONGEST_COOKIE = 500
"""Most characters of a name as its cookie holds it."""


class Context:
    """What the pages of one server share."""

    def __init__(self, settings: Settings, port: int, places: LabProvider, inside: aiohttp.ClientSession, folder: Path):
        """`port`: the public port; `inside`: the HTTP client for the labs on loopback.

        `folder`: for temporary files, removed when the server closes.
        """
        self.settings, self.port, self.places, self.inside = settings, port, places, inside
        self.temporary_folder = folder
        # With private labs, recordings need a pass even if the server has no token.
        is_closed = settings.teacher_token is not None or settings.private
        self.cookie_key = cookie_key(settings.logs if is_closed else None)
        """The key that signs cookies; the same for every server of these logs, so that a restart signs nobody out."""
        self.pass_key = secret_word() if is_closed else None
        """The key that makes passes to single recordings; None if they need none."""
        self.tasks = Tasks()
        self.measuring = Measuring(self.tasks, settings.logs)
        self.preset_cards = PresetCards(self.tasks)
        self.comparisons = TaskBook(self.tasks, folder, MOST_COMPARISONS)
        self.replays = TaskBook(self.tasks, folder, MOST_REPLAYS)
        self.studies = TaskBook(self.tasks, folder, MOST_STUDIES, Limit("studies", *MOST_AT_ONCE), long=True)
        self.boards = TaskBook(self.tasks, folder, MOST_BOARDS)
        """The leaderboard's tables and figures."""
        self.guesses = Guesses()
        """Recent wrong tokens."""
        self.pages = Limit("open pages of labs", *MOST_PAGES)
        self.viewers = Limit("viewers of live data", *MOST_VIEWERS)
        self.files = Limit("files on their way", *MOST_FILES)
        """Uploads, exports and archives, which take disk space until they are transferred."""
        self.claimed: dict[Path, int] = {}
        """Folder of a file in transfer → bytes that it may take."""

    @property
    def is_open(self) -> bool:
        """Whether everybody who reaches the server may come in."""
        return self.settings.token is None and self.settings.teacher_token is None

    def signed(self, kind: str, word: str | None) -> str:
        """The signature of a word for a cookie of this kind; it does not reveal the word and cannot be guessed."""
        return hmac.new(self.cookie_key, f"{kind} {word or ''}".encode(), "sha256").hexdigest()[:SIGNATURE]

    def cookie(self, kind: str) -> str:
        """The name of a cookie: of a token, the teacher, a visitor's name, or a visitor.

        Browsers keep cookies by host, not by port: two servers of one machine must not sign each other out. The teacher has a
        separate cookie: a teacher who opens the students' address stays the teacher.
        """
        return f"flexlab-{kind}-{self.port}"


CONTEXT = web.AppKey("context", Context)


def context_of(request: web.Request) -> Context:
    """The server that a request came to."""
    return request.app[CONTEXT]


def given_twice(fields: Any) -> str:
    """The sentence about a field that a form or an address gives twice, as one of its values would be ignored; "" if none."""
    for name, count in Counter(name for name, _ in fields.items()).items():
        if count > 1 and not SEVERAL.fullmatch(name):
            return f"{visible(name, LONGEST_FIELD)} is given twice: give it one value."
    return ""


async def form_of(request: web.Request) -> Any:
    """The fields of a form. Raises `LabError` if one is given twice."""
    form = await request.post()
    if twice := given_twice(form):
        raise LabError(twice)
    return form


def fresh(data: object) -> web.Response:
    """Return JSON for a page's script, which no browser caches."""
    return web.json_response(data, headers={hdrs.CACHE_CONTROL: "no-store"})


def as_download(name: str) -> str:
    """The header Content-Disposition of a download with this name, whatever characters it has."""
    made = Message()
    made.add_header(hdrs.CONTENT_DISPOSITION, "attachment", filename=" ".join(visible(name).split("\n")))
    return made[hdrs.CONTENT_DISPOSITION]


def file_answer(path: Path, name: str = "") -> web.FileResponse:
    """Return a file unchanged, as a download of this name if there is one."""
    headers = {hdrs.CONTENT_TYPE: "application/octet-stream", hdrs.CACHE_CONTROL: "no-cache"}
    if name:
        headers[hdrs.CONTENT_DISPOSITION] = as_download(name)
    return web.FileResponse(path, headers=headers)


def told(task: Task | None) -> web.Response:
    """Return the state of a task for its page's script; None stands for one that was never started."""
    return fresh((task or IDLE).as_data())


def same(given: str, wanted: str) -> bool:
    """Whether two words are equal, compared in a time that reveals nothing about the wanted one."""
    return hmac.compare_digest(given.encode("utf-8", "replace"), wanted.encode())


def scheme_of(request: web.Request) -> str:
    """http or https, as the visitor's browser uses it; the first of several proxies decides."""
    return request.headers.get("X-Forwarded-Proto", request.scheme).partition(",")[0].strip()


def set_cookie(
    request: web.Request,
    answer: web.StreamResponse,
    name: str,
    value: str,
    same_site: Literal["Strict", "Lax"] = "Lax",
    age: int | None = COOKIE_AGE,
) -> None:
    """Set a cookie that the browser keeps for `age` s (None: until it is closed) and that no script can read."""
    secure = scheme_of(request) == "https"
    answer.set_cookie(name, value, max_age=age, httponly=True, samesite=same_site, path="/", secure=secure)


def cookie_key(logs: Path | None) -> bytes:
    """Return the key that signs the cookies of all servers of these logs, made if missing; without logs, a new one."""
    key = secrets.token_bytes(KEY_BYTES)
    if logs is None:
        return key
    file = logs / KEY_FILE
    draft = file.with_name(f"{KEY_FILE}-{secrets.token_hex(8)}")
    with contextlib.suppress(OSError):  # If nothing can be written, a restart signs everybody out.
        try:
            if not is_regular(file):
                with open(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as begun:
                    begun.write(key)
                with contextlib.suppress(FileExistsError):  # Another server was faster: its key counts.
                    os.link(draft, file)
        finally:
            draft.unlink(missing_ok=True)
        found = file.read_bytes() if is_regular(file) else b""
        return found if len(found) == KEY_BYTES else key
    return key


_JOINED = re.compile("(?<=[^\x00-\u02ff])[\u200c\u200d](?=[^\x00-\u02ff\u200c\u200d])")
"""A character that joins two others or keeps them apart, as in Persian, Sinhala and Hindi names; not in Latin script."""


def checked_name(text: str) -> str:
    """Return a typed name without spaces around it. Raises `LabError` for one that no page should show."""
    # The length as typed comes first: normalizing thousands of accents takes seconds in which nobody else is answered.
    name = text.strip()
    name = unicodedata.normalize("NFC", name) if len(name) <= MOST_PARTS * LONGEST_NAME else name
    if len(name) > LONGEST_NAME:
        raise LabError(f"This name has {len(name)} characters: at most {LONGEST_NAME} fit. Shorten it.")
    # Category C: control characters, changes of the writing direction, surrogates, unassigned characters.
    if any(unicodedata.category(letter)[0] == "C" or letter in "\u2028\u2029" for letter in _JOINED.sub("", name)):
        raise LabError("This name holds control characters: type it with letters, digits and spaces.")
    return name


def visitor_of(request: web.Request) -> Visitor:
    """The visitor who sent a request; without an id if their browser has none yet."""
    context = context_of(request)
    try:
        given = request.cookies.get(context.cookie("name"), "")[:LONGEST_COOKIE]
        name = checked_name(unquote(given, errors="strict"))
    except (LabError, UnicodeDecodeError):
        name = ""
    word = request.cookies.get(context.cookie("visitor"), "")
    # Only an id that this server signed: made-up ones would be a new visitor at every request.
    given, _, signature = word.rpartition(".")
    word = word if same(signature, context.signed("visitor", given)) else ""
    return Visitor(word, network_of(request.remote or ""), is_teacher(request), name)


def known_visitor_of(request: web.Request) -> Visitor:
    """The visitor who sent a request, with a new id if they have none; `keep_visitor` stores it in their browser."""
    visitor = visitor_of(request)
    if visitor.id:
        return visitor
    word = secret_word()
    signature = context_of(request).signed("visitor", word)
    return replace(visitor, id=f"{word}.{signature}")


@web.middleware
async def greet(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Give a new visitor a cookie, so that many at one address are told apart."""
    answer = await handler(request)
    first = answer.status == 200 and answer.content_type == "text/html" and not answer.prepared
    visitor = visitor_of(request)
    known = visitor.is_teacher or visitor.id or context_of(request).cookie("visitor") in answer.cookies
    if first and not known:
        keep_visitor(request, answer, known_visitor_of(request))
    return answer


def keep_visitor(request: web.Request, answer: web.StreamResponse, visitor: Visitor) -> None:
    """Store a visitor's id and name in their browser."""
    context = context_of(request)
    # Lax, not strict: a visitor who follows a link from another site finds their lab, too.
    set_cookie(request, answer, context.cookie("visitor"), visitor.id)
    if visitor.name != visitor_of(request).name:
        set_cookie(request, answer, context.cookie("name"), quote(visitor.name, safe=""))


def is_teacher(request: web.Request) -> bool:
    """Whether the visitor may do everything: they have the teacher's token, or there is none."""
    return context_of(request).settings.teacher_token is None or has_teacher_cookie(request)


def has_teacher_cookie(request: web.Request) -> bool:
    """Whether the visitor has shown the teacher's token or, where there is none, opened the teacher's page."""
    context = context_of(request)
    given = request.cookies.get(context.cookie("teacher"), "")
    wanted = context.signed("teacher", context.settings.teacher_token)
    return same(given, wanted)


def has_class(request: web.Request) -> bool:
    """Whether the visitor is the teacher of a class."""
    context = context_of(request)
    return is_teacher(request) and (context.places.is_private or context.settings.has_class)


def sight(request: web.Request) -> Callable[[str], bool]:
    """Whether the visitor may see the runs of an owner: their own, a shared lab's, and all if they are the teacher."""
    visitor, shared = visitor_of(request), not context_of(request).places.is_private
    mine = visitor.owner
    return lambda owner: visitor.is_teacher or (same(owner, mine) if owner else shared)


async def runs_for(request: web.Request, most: int | None = None) -> list[RunRow]:
    """The runs that the visitor may see, or the `most` that were written last, sorted by start, newest first."""
    logs, sees = context_of(request).settings.logs, sight(request)

    def found() -> list[RunRow]:
        # Of a class's thousands of runs, those of others need not be looked at.
        return list(islice(read_rows(path for path in list_files(logs) if sees(owner_of(path))), most))

    return sorted(await with_names(request, await asyncio.to_thread(found)), key=lambda row: row.started, reverse=True)


async def with_names(request: web.Request, rows: Sequence[RunRow]) -> list[RunRow]:
    """Runs as a page shows them: for the teacher, who sees everybody's, people of one name are told apart."""
    if not visitor_of(request).is_teacher:
        return list(rows)
    return await asyncio.to_thread(told_apart, rows, context_of(request).settings.logs)


async def runs_named(request: web.Request, names: Iterable[str]) -> list[RunRow]:
    """Return runs that the visitor may see. Raises `NoSuchRun` for another's run just as for none."""
    rows = await asyncio.to_thread(find_rows, context_of(request).settings.logs, names)
    sees = sight(request)
    for row in rows:
        if not sees(row.owner):
            raise NoSuchRun(row.id)
    return rows
