"""Somebody of a class."""

import json
from urllib.parse import urlencode

from http_client import Answer, ask

from flexlab.server.front_server import FrontServer
from flexlab.server.limits import owner_word

TOKEN, TEACHER = "the-token-of-the-class", "the-teacher-s-own-token"
FORM = "application/x-www-form-urlencoded"


class Person:
    """Somebody with a browser that keeps every cookie."""

    def __init__(self, server: FrontServer, token: str = TOKEN):
        self.server, self.cookies = server, {}
        self.ask(f"/?token={token}")

    def ask(self, path: str, method: str = "GET", body: bytes | None = None, **headers: str) -> Answer:
        """One request."""
        answer = ask(self.server.url, path, method, body, cookies=self.cookies, **headers)
        for header in answer.headers.get_all("Set-Cookie") or ():
            name, _, value = header.partition(";")[0].partition("=")
            self.cookies[name] = value
        return answer

    def post(self, path: str, *fields: tuple[str, str], **headers: str) -> Answer:
        """One form."""
        return self.ask(path, "POST", urlencode(fields).encode(), Content_Type=FORM, **headers)

    @property
    def owner(self) -> str:
        """By which their runs are known."""
        return owner_word(self.cookies[f"flexlab-visitor-{self.server.port}"])

    def labs(self) -> list[dict]:
        """What the teacher's page is told."""
        return json.loads(self.ask("/teacher/labs").text)["labs"]
