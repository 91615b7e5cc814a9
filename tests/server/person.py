"""A server, and somebody with a browser that keeps every cookie: a visitor, and a person of a class."""

import json
from pathlib import Path
from typing import Any

from http_client import Answer, ask, post

from flexlab.presets import load_preset
from flexlab.server.front_server import FrontServer, open_front_server
from flexlab.server.limits import owner_word
from flexlab.server.settings import Settings

TOKEN, TEACHER = "the-token-of-the-class", "the-teacher-s-own-token"


def open_server(logs: Path, preset: str = "paper", **settings: Any) -> FrontServer:
    """A server for these people."""
    return open_front_server(
        Settings(**{"logs": logs, "port": 0, "shadows": False} | settings), load_preset(preset), preset
    )


class Visitor:
    """Somebody at a server's address."""

    def __init__(self, url: str):
        self.url, self.cookies = url, {}

    def ask(self, path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> Answer:
        """One request."""
        return self._kept(ask(self.url, path, method, body, self.cookies, **headers))

    def post(self, path: str, *fields: tuple[str, str], **headers: str) -> Answer:
        """One form."""
        return self._kept(post(self.url, path, fields, self.cookies, **headers))

    def _kept(self, answer: Answer) -> Answer:
        for header in answer.headers.get_all("Set-Cookie") or ():
            name, _, value = header.partition(";")[0].partition("=")
            self.cookies[name] = value
        return answer

    def enter(self, path: str = "/lab/") -> str:
        """The path of the lab that this visitor is sent to."""
        answer = self.ask(path)
        assert answer.status == 303, answer.text
        return answer.headers["Location"]

    def state(self, lab: str) -> str:
        """What the page of a lab is told."""
        return self.ask(f"/state{lab.rstrip('/')}").text


class Person(Visitor):
    """Somebody at a server of these tests, who signs in with a token unless it is empty."""

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
        """By which their runs are known."""
        return owner_word(self.word)

    @property
    def place(self):
        """What the server knows of their lab."""
        return self.server.places.of_visitor(self.word)

    def labs(self) -> list[dict]:
        """What the teacher's page is told."""
        return json.loads(self.ask("/teacher/labs").text)["labs"]
