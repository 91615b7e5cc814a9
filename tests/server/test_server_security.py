"""Who gets in and who does not; malformed requests are refused and logged."""

import asyncio
import contextlib
import logging
import re
import socket
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import urlsplit

import aiohttp
import pytest
from http_client import FORM, PROTOCOL, ask, upgrade, wait_until
from person import TOKEN

from flexlab.errors import LabError
from flexlab.server.front_server import FrontServer
from flexlab.server.proxy import LARGEST_MESSAGE


def cookie_of(front_server: FrontServer) -> dict[str, str]:
    return ask(front_server.url, f"/?token={TOKEN}").cookies


def test_a_local_server_needs_no_token(front_server: FrontServer):
    assert front_server.settings.token is None
    assert ask(front_server.url).status == 200


def test_a_server_that_listens_on_all_addresses_makes_and_needs_a_token(open_another: Callable[..., FrontServer]):
    front_server = open_another(host="0.0.0.0")
    assert front_server.settings.token is not None
    assert len(front_server.settings.token) >= 20
    assert front_server.url == f"http://127.0.0.1:{front_server.port}/?token={front_server.settings.token}"
    assert ask(front_server.url).status == 401


@pytest.mark.parametrize("path", ["/", "/lab/", "/lab/soft-beam", "/runs", "/viewer/", "/state/lab", "/assets/x"])
def test_no_page_without_the_token(guarded: FrontServer, path: str):
    for cookies in ({}, {f"flexlab-token-{guarded.port}": "wrong"}, {f"flexlab-token-{guarded.port}": "ä"}):
        answer = ask(guarded.url, path, cookies=cookies)
        assert answer.status == 401
        assert "Sign in" in answer.text


def test_no_websocket_without_the_token(guarded: FrontServer):
    assert ask(guarded.url, "/lab", **upgrade()).status == 401
    assert ask(guarded.url, f"/lab?token={TOKEN}", **upgrade()).status == 401
    assert ask(guarded.url, "/lab", cookies=cookie_of(guarded), **upgrade()).status == 101


def test_the_token_becomes_a_cookie_and_leaves_the_address(guarded: FrontServer):
    answer = ask(guarded.url, f"/lab/?token={TOKEN}&fixedDpr=0.5")
    assert (answer.status, answer.headers["Location"]) == (303, "/lab/?fixedDpr=0.5")
    assert "HttpOnly" in answer.headers["Set-Cookie"]
    assert "SameSite=Strict" in answer.headers["Set-Cookie"]
    assert ask(guarded.url, "/lab/", cookies=answer.cookies).status == 200
    # A strict cookie does not survive a redirect that began on another site, so a page of this server leads on instead.
    foreign = ask(guarded.url, f"/?token={TOKEN}", Sec_Fetch_Site="cross-site")
    assert (foreign.status, foreign.headers["Refresh"]) == (200, "0; url=/")
    wrong = ask(guarded.url, "/?token=wrong")
    assert (wrong.status, "Set-Cookie" in wrong.headers) == (401, False)


def test_a_pass_opens_one_recording_only(guarded: FrontServer, recorded: Path):
    logs = guarded.settings.logs
    for name in ("one", "two"):
        (logs / f"{name}.rrd").write_bytes(recorded.read_bytes())
    page = ask(guarded.url, "/runs/one", cookies=cookie_of(guarded)).text
    found = re.search(r'data-recording="(/pass/[0-9a-f]{64}/one\.rrd)"', page)
    assert found
    address = found[1]
    assert ask(guarded.url, address).body == recorded.read_bytes()
    for other in (
        address.replace("one", "two"),
        address.replace("/pass/", "/pass/0"),
        "/pass//one.rrd",
        "/runs/one.rrd",
    ):
        assert ask(guarded.url, other).status == 401
    assert ask(guarded.url, address, "POST").status == 401


def test_signing_in_redirects_to_no_other_site(guarded: FrontServer):
    answer = ask(guarded.url, f"//evil.example/?token={TOKEN}")
    assert (answer.status, answer.headers["Location"]) == (303, "/evil.example/"), "a path of this server"


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", "http://127.0.0.1:1", "https://evil.example:8080", "http://[", "http://[::::]"],
)
def test_foreign_pages_may_not_connect_or_post(front_server: FrontServer, origin: str):
    assert ask(front_server.url, "/lab", **upgrade(Origin=origin)).status == 403
    assert ask(front_server.url, "/runs/delete", "POST", Origin=origin).status == 403


def test_pages_of_this_server_may_connect(front_server: FrontServer):
    assert ask(front_server.url, "/lab", **upgrade(Origin=front_server.url.rstrip("/"))).status == 101
    host = f"localhost:{front_server.port}"
    assert ask(front_server.url, "/lab", **upgrade(Origin=f"http://{host}", Host=host)).status == 101


def test_a_foreign_name_for_this_machine_is_refused(front_server: FrontServer):
    name = f"evil.example:{front_server.port}"
    assert ask(front_server.url, "/", Host=name).status == 403
    assert ask(front_server.url, "/lab", **upgrade(Host=name, Origin=f"http://{name}")).status == 403


@pytest.mark.parametrize(
    "headers", [{"Sec_Fetch_Dest": "image"}, {"Sec_Fetch_Dest": "iframe"}, {"Sec_Purpose": "prefetch"}]
)
def test_images_frames_and_prefetches_cannot_load_a_preset(front_server: FrontServer, headers: dict[str, str]):
    assert ask(front_server.url, "/lab/soft-beam", **headers).status == 403
    assert '"name": "paper"' in ask(front_server.url, "/state/lab").text


def test_a_program_that_checks_a_link_ends_no_run(front_server: FrontServer):
    """Chats and link checkers ask by HEAD, which must change nothing."""
    assert ask(front_server.url, "/lab/soft-beam", "HEAD").status == 200
    assert '"name": "paper"' in ask(front_server.url, "/state/lab").text


@pytest.mark.parametrize("path", ["/", "/runs", "/lab/", "/viewer/", "/nowhere", "/static/style.css", "/state/lab"])
def test_every_answer_carries_security_headers(front_server: FrontServer, path: str):
    headers = ask(front_server.url, path).headers
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["X-Frame-Options"] == "SAMEORIGIN"
    assert headers["Referrer-Policy"] == "same-origin"
    assert "frame-ancestors 'self'" in headers["Content-Security-Policy"]
    assert "Server" not in headers


@pytest.mark.parametrize(
    "path",
    [
        "/assets/../pyproject.toml",
        "/assets/%2e%2e/pyproject.toml",
        "/assets/..%2fpyproject.toml",
        "/assets/..%5c..%5cpyproject.toml",
        "/static/%2e%2e/front_server.py",
        "/viewer/..%2f..%2fetc%2fpasswd",
        "/runs/..%2f..%2fpyproject.rrd",
        "/lab/%2e%2e/%2e%2e/etc/passwd",
        "/lab/..%2fpyproject.toml",
        "/assets//etc/passwd",
        "/assets/%00",
    ],
)
def test_no_file_outside_the_folders_is_served(front_server: FrontServer, path: str, caplog: pytest.LogCaptureFixture):
    answer = ask(front_server.url, path)
    assert answer.status in (400, 403, 404)
    assert b"root:" not in answer.body
    assert b"hatchling" not in answer.body
    if ".." in path or "%2e" in path:
        assert "Refused" in caplog.text


def test_an_oversized_form_is_refused(front_server: FrontServer, recorded: Path, caplog: pytest.LogCaptureFixture):
    path = f"/runs/{recorded.stem}/notes"
    answer = ask(front_server.url, path, "POST", b"note=" + b"x" * 600_000, Content_Type=FORM)
    assert answer.status == 413
    assert "larger than 512\xa0kB" in answer.text
    assert "Refused" in caplog.text
    assert "characters" in ask(front_server.url, path, "POST", b"note=" + b"x" * 3000, Content_Type=FORM).text
    assert ask(front_server.url, "/lab/", "POST", b"x", Content_Type=FORM).status == 405


async def connected(front_server: FrontServer, act: Callable) -> aiohttp.ClientWebSocketResponse:
    """Open viser's websocket, do something, read until the server closes it."""
    async with (
        aiohttp.ClientSession() as client,
        client.ws_connect(f"ws://127.0.0.1:{front_server.port}/lab", protocols=[PROTOCOL], max_msg_size=0) as plug,
    ):
        assert plug.protocol == PROTOCOL
        assert len((await plug.receive()).data) > 0, "the scene comes first"
        with contextlib.suppress(ConnectionError):  # The server may close before all of what it refuses has come.
            await act(plug)
        async with asyncio.timeout(30):
            async for _ in plug:
                pass
        return plug


@pytest.mark.parametrize(
    ("act", "codes"),
    [
        (lambda plug: plug.send_bytes(b"x" * (LARGEST_MESSAGE + 1)), {1009, 1006}),
        (lambda plug: plug.send_str("hello"), {1003}),
        (lambda plug: plug.send_bytes(b"\xc1garbage"), {1011}),
        (lambda plug: plug.send_bytes(b"\x93" * 100_000), {1011}),
    ],
)
def test_a_bad_message_closes_that_connection_only(
    front_server: FrontServer, act, codes: set[int], caplog: pytest.LogCaptureFixture
):
    caplog.set_level(logging.WARNING)
    with ThreadPoolExecutor(1) as thread:  # Playwright keeps an event loop on this one.
        plug = thread.submit(asyncio.run, connected(front_server, act)).result()
    assert plug.close_code in codes
    wait_until(lambda: "Refused" in caplog.text, "the log tells of it")
    assert "Traceback" not in caplog.text
    assert ask(front_server.url, "/lab", **upgrade()).status == 101


def test_a_malformed_frame_closes_that_connection_only(front_server: FrontServer, caplog: pytest.LogCaptureFixture):
    with socket.create_connection(("127.0.0.1", front_server.port), timeout=30) as plug:
        lines = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in upgrade().items())
        plug.sendall(f"GET /lab HTTP/1.1\r\nHost: 127.0.0.1:{front_server.port}\r\n{lines}\r\n".encode())
        assert plug.recv(12) == b"HTTP/1.1 101"
        plug.sendall(b"\xff\xff\xff\xff\xff\xff\xff\xff")
        while plug.recv(1 << 16):
            pass
    wait_until(lambda: "Refused" in caplog.text, "the log tells of it")
    assert ask(front_server.url, "/lab", **upgrade()).status == 101


def test_a_busy_port_is_refused_and_no_recording_is_left_behind(
    open_another: Callable[..., FrontServer], front_server: FrontServer, tmp_path
):
    with pytest.raises(LabError, match="in use"):
        open_another(port=urlsplit(front_server.url).port)
    assert list((tmp_path / "logs").glob("*.rrd")) == []
