"""What the pages of one server share."""

import hmac
from dataclasses import dataclass, field
from pathlib import Path

import aiohttp
from aiohttp import hdrs, web

from flexlab.server.labs.lab_provider import LabProvider
from flexlab.server.limits import Guesses, Limit
from flexlab.server.preset_cards import PresetCards
from flexlab.server.run_jobs import Measuring
from flexlab.server.settings import Settings
from flexlab.server.task_book import IDLE, Task, TaskBook
from flexlab.server.tasks import Tasks

MOST_PAGES = 12, 120, 128, 8
"""Open pages of labs: of one visitor, of one address, of all, and more for the teacher."""
MOST_VIEWERS = 4, 40, 48, 4
"""Viewers of live data: each takes as much of the line as a film, and a class behind one address has one each."""
MOST_FILES = 2, 30, 40, 4
"""Files on their way: a class behind one address asks for one each at once. `claim_room` bounds their bytes."""
SIGNATURE = 40
"""Hexadecimal digits of a signature in a cookie."""


@dataclass(frozen=True)
class Context:
    """One server."""

    settings: Settings
    port: int
    """The public port that it listens on."""
    cookie_key: bytes
    """The key that signs cookies; the same for every server of these logs, so that a restart signs nobody out."""
    pass_key: str | None
    """The key that makes passes to single recordings; None: they need none."""
    places: LabProvider
    inside: aiohttp.ClientSession
    """Calls to the labs on loopback."""
    measuring: Measuring
    tasks: Tasks
    comparisons: TaskBook
    replays: TaskBook
    studies: TaskBook
    boards: TaskBook
    """The leaderboard's tables and figures."""
    temporary_folder: Path
    """A folder for files that nobody keeps; gone when the server closes."""
    preset_cards: PresetCards
    guesses: Guesses = field(default_factory=Guesses)
    """Wrong tokens of late."""
    pages: Limit = field(default_factory=lambda: Limit("open pages of labs", *MOST_PAGES))
    viewers: Limit = field(default_factory=lambda: Limit("viewers of live data", *MOST_VIEWERS))
    files: Limit = field(default_factory=lambda: Limit("files on their way", *MOST_FILES))
    """Uploads, exports and archives, which take room on the disk until the other side has them."""
    claimed: dict[Path, int] = field(default_factory=dict[Path, int])
    """Folder of a file on its way → bytes that it may take."""

    @property
    def is_open(self) -> bool:
        """Whether everybody who reaches the server may come in."""
        return self.settings.token is None and self.settings.teacher_token is None

    def signed(self, kind: str, word: str | None) -> str:
        """The signature of a word, which a cookie of this kind holds: it neither reveals the word nor can be guessed."""
        return hmac.new(self.cookie_key, f"{kind} {word or ''}".encode(), "sha256").hexdigest()[:SIGNATURE]

    def cookie(self, kind: str) -> str:
        """The name of a cookie: of a token, the teacher, a visitor's name, or a visitor.

        Browsers keep cookies by host, not by port: two servers of one machine must not sign each other out. The teacher's is
        another one: a teacher who opens the students' address stays the teacher.
        """
        return f"flexlab-{kind}-{self.port}"


CONTEXT = web.AppKey("context", Context)


def context_of(request: web.Request) -> Context:
    """The server that a request came to."""
    return request.app[CONTEXT]


def fresh(data: object) -> web.Response:
    """JSON for a page's script; no browser keeps it."""
    return web.json_response(data, headers={hdrs.CACHE_CONTROL: "no-store"})


def file_answer(path: Path, name: str = "") -> web.FileResponse:
    """A file as it is: for the viewer, and under this name where a browser keeps it."""
    headers = {hdrs.CONTENT_TYPE: "application/octet-stream", hdrs.CACHE_CONTROL: "no-cache"}
    if name:
        headers[hdrs.CONTENT_DISPOSITION] = f'attachment; filename="{name}"'
    return web.FileResponse(path, headers=headers)


def told(task: Task | None) -> web.Response:
    """The state of a task, for the script in its page; also of one that nobody has begun."""
    return fresh((task or IDLE).as_data())
