"""What visits a server in the tests: plain HTTP without a browser's kindness, and websockets as viser's page opens them."""

import http.client
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from email.message import Message
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import viser

PATIENCE = 60.0
"""Wall seconds that anything may take on a busy machine; no test passes or fails by speed."""
ARTIFACTS = Path(__file__).parents[2] / ".artifacts"
"""Screenshots for people to look at."""
PROTOCOL = f"viser-v{viser.__version__}"


@dataclass(frozen=True)
class Answer:
    """What came back."""

    status: int
    headers: Message
    """Names in any case; None for what is not there."""
    body: bytes

    @property
    def text(self) -> str:
        """The body as text."""
        return self.body.decode()

    @property
    def cookies(self) -> dict[str, str]:
        """Cookies that it sets."""
        jar = SimpleCookie(self.headers["Set-Cookie"] or "")
        return {name: morsel.value for name, morsel in jar.items()}


def ask(
    url: str,
    path: str = "/",
    method: str = "GET",
    body: bytes | None = None,
    cookies: Mapping[str, str] | None = None,
    **headers: str,
) -> Answer:
    """One request, its path sent as it stands, redirects not followed. `headers`: names with _ for -."""
    port = urlsplit(url).port
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=PATIENCE)
    sent = {name.replace("_", "-"): value for name, value in headers.items()}
    if cookies:
        sent["Cookie"] = "; ".join(f"{name}={value}" for name, value in cookies.items())
    try:
        connection.request(method, path, body, sent)
        answer = connection.getresponse()
        return Answer(answer.status, answer.headers, answer.read())
    finally:
        connection.close()


def upgrade(**more: str) -> dict[str, str]:
    """Headers with which a browser asks for viser's websocket."""
    return {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec_WebSocket_Version": "13",
        "Sec_WebSocket_Key": "AAAAAAAAAAAAAAAAAAAAAA==",
        "Sec_WebSocket_Protocol": PROTOCOL,
        **more,
    }


def wait_until(look: Callable[[], Any], what: str, patience: float = PATIENCE) -> Any:
    """Look until there is something true and return it."""
    deadline = time.monotonic() + patience
    while True:
        found = look()
        if found:
            return found
        assert time.monotonic() < deadline, f"waited {patience:g} s in vain for: {what} (last: {found!r})"
        time.sleep(0.05)
