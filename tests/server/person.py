"""A server, and visitors who keep every cookie as a browser does."""

import json
from pathlib import Path
from typing import Any

from http_client import Answer, ask, post

from flexlab.presets import load_preset
from flexlab.server import limits
from flexlab.server.front_server import FrontServer, open_front_server
from flexlab.server.settings import Settings

TOKEN, TEACHER = "the-token-of-the-class", "the-teacher-s-own-token"


def open_server(logs: Path, preset: str = "paper", **settings: Any) -> FrontServer:
    """Open a server on a free port, without shadows unless `settings` ask for them."""
    return open_front_server(
        Settings(**{"logs": logs, "port": 0, "shadows": False} | settings), load_preset(preset), preset
    )


class Visitor:
    """A visitor to a server's address, who keeps every cookie."""

    def __init__(self, url: str):
        self.url, self.cookies = url, {}

    def ask(self, path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> Answer:
        """Send one request."""
        return self._kept(ask(self.url, path, method, body, self.cookies, **headers))

    def post(self, path: str, *fields: tuple[str, str], **headers: str) -> Answer:
        """Send one form."""
        return self._kept(post(self.url, path, fields, self.cookies, **headers))

    def _kept(self, answer: Answer) -> Answer:
        for header in answer.headers.get_all("Set-Cookie") or ():
            name, _, value = header.partition(";")[0].partition("=")
            self.cookies[name] = value
        return answer

    def enter(self, path: str = "/lab/") -> str:
        """Ask for a lab and return the path of the one that the visitor is sent to."""
        answer = self.ask(path)
        assert answer.status == 303, answer.text
        return answer.headers["Location"]

    def state(self, lab: str) -> str:
        """The state of a lab as its page gets it, JSON."""
        return self.ask(f"/state{lab.rstrip('/')}").text


class Person(Visitor):
    """A visitor to a server in this process, who signs in with a token unless it is empty."""

    def __init__(self, server: FrontServer, token: str = TOKEN):
        super().__init__(server.url)
        self.server = server
        if token:
            self.ask(f"/?token={token}")

    @property
    def word(self) -> str:
        """The secret word of their cookie."""
        return self.cookies[f"flexlab-visitor-{self.server.port}"]

    @property
    def owner(self) -> str:
        """The mark of their runs."""
        return limits.Visitor(self.word).owner

    @property
    def place(self) -> Any:
        """Their running lab; None if they have none."""
        return self.server.places.of_visitor(self.word)

    def labs(self) -> list[dict]:
        """The state of all labs, as the teacher's page gets it."""
        return json.loads(self.ask("/teacher/labs").text)["labs"]
