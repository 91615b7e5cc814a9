"""A malformed request costs one short log line that quotes none of it; wrong tokens and cookies lock nobody out."""

import logging
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from http_client import FORM, PROTOCOL, ask, upgrade, wait_until
from person import TOKEN

from flexlab.server.front_server import FrontServer
from flexlab.server.limits import MOST_PENDING


def send(server: FrontServer, words: bytes, ends: bool = False) -> bytes:
    """Send these bytes and return what comes back until the server closes the connection. `ends`: say that no more follow."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as plug:
        plug.sendall(words)
        if ends:
            plug.shutdown(socket.SHUT_WR)
        with plug.makefile("rb") as answer:
            return answer.read()


HEAD = b"Host: 127.0.0.1\r\n"
MALFORMED = {
    "no HTTP": b"\x00\xff\x1b[2J\r\n\r\n",
    "a long cookie": b"GET / HTTP/1.1\r\n" + HEAD + b"Cookie: secret-of-the-class=" + b"x" * 8300 + b"\r\n\r\n",
    "a long address": b"GET /secret-of-the-class" + b"x" * 9000 + b" HTTP/1.1\r\n" + HEAD + b"\r\n",
    "a header without a name": b"GET / HTTP/1.1\r\n" + HEAD + b": secret-of-the-class\r\n\r\n",
    "two lengths": b"POST / HTTP/1.1\r\n" + HEAD + b"Content-Length: 3\r\nContent-Length: 4\r\n\r\nabcd",
    "a broken chunk": b"POST /name HTTP/1.1\r\n" + HEAD + b"Transfer-Encoding: chunked\r\n\r\nsecret\r\n",
    "a broken chunk where nothing is taken": (
        b"POST /nowhere HTTP/1.1\r\n" + HEAD + b"Transfer-Encoding: chunked\r\n\r\nsecret\r\n"
    ),
    "a body that is not packed as it says": (
        b"POST /name HTTP/1.1\r\n" + HEAD + b"Content-Encoding: gzip\r\nContent-Length: 6\r\n\r\nsecret"
    ),
    "an odd version": b"GET / HTTP/9.secret-of-the-class\r\n" + HEAD + b"\r\n",
    "a method that is none": b"SECRET-OF-THE-CLASS" * 300 + b" / HTTP/1.1\r\n" + HEAD + b"\r\n",
}


@pytest.mark.parametrize("kind", MALFORMED)
def test_a_malformed_request_is_logged_in_one_line_that_quotes_nothing(
    guarded: FrontServer, kind: str, caplog: pytest.LogCaptureFixture
):
    caplog.set_level(logging.DEBUG)
    caplog.set_level(logging.WARNING, "numba")  # It logs every line that another thread compiles.
    answer = send(guarded, MALFORMED[kind])
    assert answer.startswith((b"HTTP/1.1 4", b"HTTP/1.0 4")), answer[:100]
    wait_until(lambda: caplog.records, "the log tells of it")
    lines = [logging.Formatter().format(record) for record in caplog.records]
    assert all("\n" not in line and len(line) < 300 for line in lines), lines
    assert "secret" not in "".join(lines).lower()
    assert not any(record.exc_info for record in caplog.records)
    assert b"secret" not in answer.lower()


@pytest.mark.parametrize("path", ["/", "/runs", "/lab/", "/static/style.css"])
def test_a_visitor_who_ends_their_sending_is_answered(front_server: FrontServer, path: str):
    """Programs such as `nc -N` say by it that their request is whole. They got no answer."""
    request = f"GET {path} HTTP/1.1\r\n".encode() + HEAD + b"\r\n"
    for _ in range(5):  # A file is opened by another thread, before or after the visitor's end is seen.
        assert send(front_server, request, ends=True).startswith(b"HTTP/1.1 200 OK")


@pytest.mark.parametrize(
    "offered", ["\xff", "secret" * 500, f"{PROTOCOL}, secret", f"{PROTOCOL}x{'secret' * 10}", "a b"]
)
def test_an_odd_protocol_of_a_websocket_is_refused_and_not_logged(
    front_server: FrontServer, offered: str, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
):
    """A byte that is no text was a traceback, and any word a line of up to 8 kB."""
    answer = ask(front_server.url, "/lab/", **upgrade(Sec_WebSocket_Protocol=offered))
    assert (answer.status, "This request is malformed: send it again." in answer.text) == (400, True)
    assert "secret" not in caplog.text + capfd.readouterr().err
    assert "Traceback" not in caplog.text


def test_a_visitor_who_leaves_after_an_early_answer_is_not_called_slow(
    front_server: FrontServer, caplog: pytest.LogCaptureFixture
):
    """The rest of a form that came after its answer counted as a request: ten seconds later the log called it too slow."""
    with socket.create_connection(("127.0.0.1", front_server.port), timeout=30) as plug:
        plug.sendall(b"POST /runs/none/notes HTTP/1.1\r\n" + HEAD + f"Content-Type: {FORM}\r\n".encode())
        plug.sendall(b"Content-Length: 6\r\n\r\n")
        assert plug.recv(12) == b"HTTP/1.1 404"
        plug.sendall(b"note=x")
        time.sleep(0.2)
        plug.shutdown(socket.SHUT_WR)
        while plug.recv(1 << 16):
            pass
    assert "too long" not in caplog.text


def test_many_malformed_requests_do_not_fill_the_log(guarded: FrontServer, caplog: pytest.LogCaptureFixture):
    for _ in range(400):
        send(guarded, MALFORMED["no HTTP"])
    assert 0 < len(caplog.records) < 300


def test_a_long_address_is_cut_in_the_log(guarded: FrontServer, caplog: pytest.LogCaptureFixture):
    ask(guarded.url, "/" + "y" * 7000)
    ask(guarded.url, "/", "Y" * 7000)
    ask(guarded.url, "/", Host="y" * 7000)
    assert all(len(record.getMessage()) < 700 for record in caplog.records)


def test_wrong_cookies_lock_nobody_out(guarded: FrontServer):
    begun = time.monotonic()
    for number in range(100):
        cookies = {f"flexlab-{kind}-{guarded.port}": f"wrong-{number}" for kind in ("token", "teacher")}
        assert ask(guarded.url, "/", cookies=cookies).status == 401
    assert ask(guarded.url, f"/?token={TOKEN}").status == 303
    assert time.monotonic() - begun < 20.0, "none was held back"


def test_the_cookie_is_not_the_token(guarded: FrontServer):
    signed_in = ask(guarded.url, f"/?token={TOKEN}")
    assert TOKEN not in str(signed_in.headers.get_all("Set-Cookie"))
    assert ask(guarded.url, "/", cookies=signed_in.cookies).status == 200
    assert ask(guarded.url, "/", cookies={f"flexlab-token-{guarded.port}": TOKEN}).status == 401


def test_visitors_stay_signed_in_after_a_restart(open_another: Callable[..., FrontServer]):
    first = open_another(token=TOKEN)
    cookies = ask(first.url, f"/?token={TOKEN}").cookies
    first.close()
    second = open_another(token=TOKEN, port=first.port)
    assert ask(second.url, "/", cookies=cookies).status == 200


def test_few_answers_are_held_back_at_once_and_signed_in_visitors_get_in(open_another: Callable[..., FrontServer]):
    server = open_another(token=TOKEN)
    cookies = ask(server.url, f"/?token={TOKEN}").cookies
    statuses: list[int] = []

    def guess(number: int) -> None:
        statuses.append(ask(server.url, f"/?token=wrong-{number}").status)

    threads = [threading.Thread(target=guess, args=(number,)) for number in range(60)]
    for thread in threads:
        thread.start()
    assert ask(server.url, "/", cookies=cookies).status == 200
    for thread in threads:
        thread.join()
    assert statuses.count(429) >= 60 - 10 - 2 * MOST_PENDING, statuses
    assert set(statuses) == {401, 429}
    assert ask(server.url, f"/?token={TOKEN}").status == 303, "the right token passes as soon as nobody guesses"


@pytest.mark.parametrize("forged", ["", "x", "visitor-of-somebody", "a" * 24 + "." + "0" * 32, "ä", "x" * 4000])
def test_a_forged_visitor_cookie_is_replaced(open_another: Callable[..., FrontServer], forged: str):
    server = open_another(private=True, max_sessions=2)
    answer = ask(server.url, "/lab/", cookies={f"flexlab-visitor-{server.port}": forged})
    given = answer.cookies[f"flexlab-visitor-{server.port}"]
    assert answer.status == 303
    assert given != forged
    assert server.places.of_visitor(forged) is None
    again = ask(server.url, "/lab/", cookies=answer.cookies)
    assert again.headers["Location"] == answer.headers["Location"]


def test_only_its_owner_may_read_the_cookie_key(open_another: Callable[..., FrontServer], tmp_path: Path):
    open_another(token=TOKEN)
    (key,) = (tmp_path / "logs").glob(".*key*")
    assert key.stat().st_mode & 0o077 == 0


PARTS = {
    "an endless character set": b'name="_charset_"\r\n\r\n' + b"x" * 500,
    "an unknown packing": b'name="file"; filename="a.csv"\r\nContent-Encoding: klingon\r\n\r\n1',
    "an unknown transfer encoding": b'name="file"; filename="a.csv"\r\nContent-Transfer-Encoding: klingon\r\n\r\n1',
    "broken deflate": b'name="file"; filename="a.csv"\r\nContent-Encoding: deflate\r\n\r\n' + b"1" * 1000,
    "broken base64": b'name="file"; filename="a.csv"\r\nContent-Transfer-Encoding: base64\r\n\r\n\xff!!!1',
    "half a character": b'name="file"; filename="\xed\xa0\x80.csv"\r\n\r\n1',
    "a lone surrogate": b"name=\"file\"; filename*=UTF-8''%ED%A0%80.csv\r\n\r\n1",
    "a control sequence": b"name=\"file\"; filename*=klingon''%1B[2J.csv\r\n\r\n1",
    "a name of 5000 letters": b'name="file"; filename="' + b"a" * 5000 + b'.csv"\r\n\r\n1',
    "a length that lies": b'name="file"; filename="a.csv"\r\nContent-Length: -5\r\n\r\n1',
    "parts in parts": b'name="file"; filename="a.csv"\r\nContent-Type: multipart/mixed; boundary=y\r\n\r\n--y\r\n\r\n1\r\n--y--',
    "parts in parts without end": b'name="a"\r\nContent-Type: multipart/mixed; boundary=b0\r\n\r\n'
    + b"".join(b"--b%d\r\nContent-Type: multipart/mixed; boundary=b%d\r\n\r\n" % (k, k + 1) for k in range(3000)),
}


@pytest.mark.parametrize("kind", PARTS)
def test_an_odd_upload_is_refused_in_a_sentence(front_server: FrontServer, kind: str, caplog: pytest.LogCaptureFixture):
    body = b"--x\r\nContent-Disposition: form-data; " + PARTS[kind] + b"\r\n--x--\r\n"
    answer = ask(front_server.url, "/runs/import", "POST", body, Content_Type="multipart/form-data; boundary=x")
    assert answer.status in (400, 422), answer.text
    assert "failed" not in answer.text
    assert not any(record.exc_info for record in caplog.records)


@pytest.mark.parametrize("path", ["/assets/", "/static/", "/runs/", "/lab/", "/studies/", "/viewer/", "/comparison/"])
def test_an_endless_or_invalid_name_is_refused(front_server: FrontServer, path: str, caplog: pytest.LogCaptureFixture):
    for name in ("x" * 3000, "%ED%A0%80", "%FF"):
        answer = ask(front_server.url, path + name)
        assert answer.status in (400, 404), answer.text
    assert not any(record.exc_info for record in caplog.records)


def test_the_name_of_an_upload_does_not_reach_the_terminal():
    script = "import flexlab.server.pages.runs_pages as u, aiohttp.multipart as m; m.parse_content_disposition(%r)"
    name = "form-data; name=\"file\"; filename*=klingon''\x1b[2J.csv"
    told = subprocess.run([sys.executable, "-c", script % name], capture_output=True, text=True, check=True)
    assert told.stderr == ""
