"""A class behind one address: everybody gets a lab, page, viewer and file, and yet no machine can take everything."""

import asyncio
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from multiprocessing import forkserver
from pathlib import Path

import pytest
from http_client import ask, run_apart, upload, wait_until

from flexlab.errors import RecordingError
from flexlab.machine import cores
from flexlab.server import connections
from flexlab.server.front_server import FrontServer
from flexlab.server.labs import FullError, Lab
from flexlab.server.limits import FREE, MOST_HELD, MOST_PENDING, Guesses, Limit, Visitor, network_of
from flexlab.server.pages.run_actions import KEPT_FREE, _check_room
from flexlab.server.visitors import MOST_FILES, MOST_PAGES, MOST_VIEWERS

CLASS = 25
ADDRESS = "192.0.2.7"


@pytest.mark.parametrize("most", [MOST_PAGES, MOST_VIEWERS, MOST_FILES])
@pytest.mark.parametrize("names", [[f"student-{number}" for number in range(CLASS)], [""] * CLASS])
def test_limits_leave_everybody_at_one_address_a_place(most: tuple[int, int, int, int], names: list[str]):
    limit = Limit("things", *most)
    with ExitStack() as held:
        for name in names:
            held.enter_context(limit.place(Visitor(name, ADDRESS)))
        limit.check(Visitor("somebody", "198.51.100.1"))
        limit.check(Visitor("", ADDRESS, is_teacher=True))


def test_the_first_page_sets_a_visitor_s_cookie_which_nobody_can_make_up(open_another: Callable[..., FrontServer]):
    server = open_another(teacher_token="the-teacher-s-own-token")
    cookie = f"flexlab-visitor-{server.port}"
    first = ask(server.url, "/")
    assert cookie in first.cookies
    assert cookie not in ask(server.url, "/", cookies=first.cookies).cookies
    assert ask(server.url, "/", cookies={cookie: "made-up"}).cookies[cookie] != "made-up"


def test_visitors_without_the_token_get_no_cookie(open_another: Callable[..., FrontServer]):
    server = open_another(token="the-token-of-the-class")
    assert not ask(server.url, "/").cookies


def in_server(server: FrontServer, work):
    """Run a coroutine on the server's event loop and return its result."""
    assert server._loop is not None
    return asyncio.run_coroutine_threadsafe(work, server._loop).result()


def test_simultaneous_visitors_get_the_free_labs_and_the_others_wait_in_line(open_another: Callable[..., FrontServer]):
    server = open_another(private=True, max_sessions=2, max_per_address=2)

    async def enter_together() -> list[Lab | BaseException]:
        visitors = [server.places.enter(Visitor(f"visitor-{number}", ADDRESS), None) for number in range(4)]
        return await asyncio.gather(*visitors, return_exceptions=True)

    found = in_server(server, enter_together())
    refused = [each for each in found if isinstance(each, FullError)]
    assert [each.place for each in refused] == [1, 2], found
    assert len({each.path for each in found if not isinstance(each, BaseException)}) == 2


@contextmanager
def standing(pid: int) -> Iterator[None]:
    """Suspend a process for the time of a `with` block."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


@pytest.mark.skipif(sys.platform != "linux", reason="labs are forked on Linux only")
def test_pages_are_served_while_labs_open(open_another: Callable[..., FrontServer]):
    count = cores() + 6
    server = open_another(private=True, max_sessions=count, max_per_address=count)
    pid = forkserver._forkserver._forkserver_pid  # type: ignore[attr-defined]
    begun: list[asyncio.Task[Lab]] = []

    async def begin() -> None:
        for number in range(count):
            begun.append(asyncio.create_task(server.places.enter(Visitor(f"visitor-{number}", ADDRESS), None)))
        await asyncio.sleep(1.0)

    async def end() -> None:
        await asyncio.gather(*begun)

    with standing(pid):
        in_server(server, begin())
        assert ask(server.url, "/static/style.css").status == 200
    in_server(server, end())


@pytest.mark.skipif(sys.platform != "linux", reason="Linux tells of who takes nothing")
def test_a_visitor_who_reads_nothing_of_a_download_is_cut_off(
    open_another: Callable[..., FrontServer],
    recorded: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
):
    monkeypatch.setattr(connections, "STALLED_TIME", 1.0)
    server = open_another()
    path = Path(shutil.copy(recorded, server.settings.logs))
    os.truncate(path, 80_000_000)
    with socket.socket() as plug:
        plug.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        plug.connect(("127.0.0.1", server.port))
        plug.sendall(f"GET /runs/{path.name} HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n\r\n".encode())
        assert plug.recv(12) == b"HTTP/1.1 200"
        wait_until(lambda: "who read nothing" in caplog.text, "its handle is given back")
    assert not any(record.exc_info for record in caplog.records)


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("2001:db8:1:2::1", "2001:db8:1:2:ffff::9", True),
        ("2001:db8:1:2::1", "2001:db8:1:3::1", False),
        ("fe80::1%eth0", "fe80::2", True),
        ("::ffff:192.0.2.7", "192.0.2.7", True),
        ("192.0.2.7", "192.0.2.8", False),
        ("", "", True),
    ],
)
def test_all_addresses_of_one_ipv6_network_count_as_one(one: str, other: str, same: bool):
    assert (network_of(one) == network_of(other)) is same


def test_many_addresses_that_guess_tokens_lock_nobody_else_out():
    async def play() -> None:
        guesses = Guesses()
        begun = [
            asyncio.create_task(guesses.slow_down(f"198.51.100.{place}"))
            for place in range(2 * MOST_HELD // MOST_PENDING)
            for _ in range(int(FREE) + MOST_PENDING)
        ]
        await asyncio.sleep(0)
        assert guesses.is_flooding("198.51.100.0")
        assert not guesses.is_flooding(ADDRESS), "who has not guessed may come in"
        assert sum(not each.done() for each in begun) == MOST_HELD
        for each in begun:
            each.cancel()
        await asyncio.gather(*begun, return_exceptions=True)
        began = time.monotonic()
        await guesses.slow_down(ADDRESS)
        assert time.monotonic() - began < 1.0, "a first mistake costs nothing"

    run_apart(play())


def test_files_in_transfer_claim_disk_space_together(tmp_path: Path):
    free = shutil.disk_usage(tmp_path).free - KEPT_FREE
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        folder.mkdir()
    half = int(0.6 * free)
    _check_room(one, {one: half})
    with pytest.raises(RecordingError, match="The disk of this server has"):
        _check_room(other, {one: half, other: half})
    (one / "file").touch()
    os.truncate(one / "file", half)
    _check_room(other, {one: half, other: half // 2})


@pytest.mark.parametrize("name", ["odd.csv", "odd.rrd", "odd.npz", "odd.parquet"])
def test_a_refused_import_is_named_without_its_folder(front_server: FrontServer, name: str):
    answer = upload(front_server.url, name, b"1,2")
    assert answer.status == 422
    assert name in answer.text
    assert "file-" not in answer.text
    assert str(front_server.temporary_folder.parent) + "/" not in answer.text


def test_only_the_first_parts_of_an_upload_are_read(front_server: FrontServer):
    part = b'--x\r\nContent-Disposition: form-data; name="a"\r\n\r\n1\r\n'
    last = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a.csv"\r\n\r\n1\r\n--x--\r\n'
    answer = ask(
        front_server.url, "/runs/import", "POST", 200 * part + last, Content_Type="multipart/form-data; boundary=x"
    )
    assert (answer.status, "There is no file in this upload" in answer.text) == (422, True)


CRAMPED = """
import asyncio, os, resource
from pathlib import Path
from flexlab.errors import LabError
from flexlab.presets import load_preset
from flexlab.server.labs import Choice, Order
from flexlab.server.labs.per_visitor import PrivateLabs
from flexlab.server.limits import THE_SERVER, Visitor
from flexlab.server.settings import Settings
from flexlab.server.tasks import Tasks, OUT_OF_MEMORY

async def main():
    tasks = Tasks()
    order = Order(Choice(load_preset("paper"), "paper"), Path("logs"), "")
    labs, anna = PrivateLabs(Settings(private=True, max_sessions=1), order), Visitor("anna")
    await asyncio.to_thread(int)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (len(os.listdir("/proc/self/fd")) + 1, hard))
    for work in (tasks.run(THE_SERVER, abs, -1), labs.enter(anna, None)):
        try:
            await work
        except LabError as error:
            print(error)
    resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    print((await labs.enter(anna, None)).path[:3], await labs.close() is not None)
    print(await tasks.run(THE_SERVER, abs, -1), await tasks.run(THE_SERVER, OUT_OF_MEMORY.read_text), len(tasks._processes))

if __name__ == "__main__":
    asyncio.run(main())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_a_task_or_lab_that_cannot_begin_says_why_and_gives_its_place_back(tmp_path: Path):
    script = tmp_path / "cramped.py"
    script.write_text(CRAMPED)
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert "This task cannot begin (Too many open files)" in done.stdout, done.stderr
    assert "The lab cannot be opened (Too many open files)" in done.stdout, done.stderr
    assert done.stdout.split()[-5:] == ["/s/", "True", "1", "1000", "0"]
