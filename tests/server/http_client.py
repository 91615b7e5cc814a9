"""How tests visit a server: HTTP requests that are sent exactly as given, and websockets as viser's page opens them."""

import asyncio
import contextlib
import http.client
import json
import re
import threading
from collections.abc import Coroutine, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from email.message import Message
from http.cookies import SimpleCookie
from typing import Any
from urllib.parse import urlencode, urlsplit

import msgspec.msgpack
import viser
from raw_browser import CAMERA, page_report, text_of
from waiting import ARTIFACTS as ARTIFACTS
from waiting import PATIENCE
from waiting import wait_until as wait_until
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

FORM = "application/x-www-form-urlencoded"
PROTOCOL = f"viser-v{viser.__version__}"
WAY, RUN = re.compile(r'class="fl-reports" data-way="([^"]+)"'), re.compile(r'class="fl-run" data-run="(\d+)"')
"""Id of the widget to which a page reports what it has drawn, and number of the run that it was sent."""


def run_apart(work: Coroutine[Any, Any, Any]) -> Any:
    """The result of a coroutine, run on a thread of its own: a browser of earlier tests keeps its loop on this one."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, work).result()


@dataclass(frozen=True)
class Answer:
    """The server's answer to a request."""

    status: int
    headers: Message
    """Found by a name in any case; None for a header that is not there."""
    body: bytes

    @property
    def text(self) -> str:
        """The body as text."""
        return self.body.decode()

    @property
    def cookies(self) -> dict[str, str]:
        """The cookies that it sets."""
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
    """Send one request, its path unchanged, and follow no redirect. `headers`: names with _ for -."""
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


Fields = Mapping[str, str] | Sequence[tuple[str, str]]


def post(url: str, path: str, fields: Fields, cookies: Mapping[str, str] | None = None, **headers: str) -> Answer:
    """Send one form."""
    return ask(url, path, "POST", urlencode(fields).encode(), cookies, Content_Type=FORM, **headers)


def file_form(name: str, content: bytes) -> tuple[bytes, str]:
    """Return (body, content type) of a form with one file."""
    border = "border-of-the-test"
    head = f'--{border}\r\nContent-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'
    return head.encode() + content + f"\r\n--{border}--\r\n".encode(), f"multipart/form-data; boundary={border}"


def upload(url: str, name: str, content: bytes, cookies: Mapping[str, str] | None = None) -> Answer:
    """Upload one file into the library."""
    body, kind = file_form(name, content)
    return ask(url, "/runs/import", "POST", body, cookies, Content_Type=kind)


def compared(url: str, *runs: str) -> tuple[str, Answer]:
    """Compare these runs and return (address, page) once the comparison is there."""
    place = ask(url, "/compare?" + "&".join(f"run={run}" for run in runs)).headers["Location"]
    over(url, f"/compare/{place.rpartition('of=')[2]}/state")
    return place, ask(url, place)


def over(url: str, address: str, patience: float = PATIENCE) -> dict[str, Any]:
    """Wait until the task at an address has ended and return its state, as a page gets it."""

    def told() -> dict[str, Any]:
        state = json.loads(ask(url, address).text)
        return {} if state["working"] else state

    return wait_until(told, f"the task of {address} is over", patience)


def upgrade(**more: str) -> dict[str, str]:
    """The headers with which a browser asks for viser's websocket."""
    return {
        "Connection": "Upgrade",
        "Upgrade": "websocket",
        "Sec_WebSocket_Version": "13",
        "Sec_WebSocket_Key": "AAAAAAAAAAAAAAAAAAAAAA==",
        "Sec_WebSocket_Protocol": PROTOCOL,
        **more,
    }


@contextlib.contextmanager
def looking(url: str, path: str, cookies: Mapping[str, str] | None = None) -> Iterator[None]:
    """Look at a lab as a page does, and report each run as drawn: runs wait for that report, and pause while nobody looks."""
    sent = {"Cookie": "; ".join(f"{name}={value}" for name, value in cookies.items())} if cookies else {}
    protocol: Any = PROTOCOL
    address = f"ws://{urlsplit(url).netloc}{path}"
    with connect(
        address, subprotocols=[protocol], additional_headers=sent, max_size=None, close_timeout=0.2, ping_interval=None
    ) as plug:
        plug.send(msgspec.msgpack.encode(CAMERA))
        over = threading.Event()

        def read() -> None:
            way, run, drawn = "", "", ""
            with contextlib.suppress(ConnectionClosed):
                while not over.is_set():
                    data = plug.recv()
                    assert isinstance(data, bytes)
                    told = text_of(data)
                    way = (WAY.findall(told) or [way])[-1]
                    run = (RUN.findall(told) or [run])[-1]
                    if way and run != drawn:
                        drawn = run
                        message = {"type": "GuiUpdateMessage", "uuid": way, "updates": {"value": page_report(int(run))}}
                        plug.send(msgspec.msgpack.encode(message))

        reader = threading.Thread(target=read, daemon=True)
        reader.start()
        try:
            yield
        finally:
            over.set()
    reader.join()
