"""Live data reach rerun viewers through the front server only: rerun opens no port, and nobody gets in without the token."""

import contextlib
import subprocess
from collections.abc import Callable
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import psutil
from http_client import ask, wait_until
from person import TOKEN

from flexlab.recording.rerun_internals.chunks import quiet_reader
from flexlab.recording.rerun_internals.tool import rerun_tool
from flexlab.server.front_server import FrontServer


def listening() -> set[int]:
    """The ports on which this process and its children listen."""
    me, ports = psutil.Process(), set[int]()
    for process in (me, *me.children(recursive=True)):
        with contextlib.suppress(psutil.NoSuchProcess):
            known = process.net_connections(kind="inet")
            ports |= {each.laddr.port for each in known if each.status == psutil.CONN_LISTEN}
    return ports


def watch(source: str, path: Path, wanted: set[str]) -> None:
    """Let a real rerun program watch a lab until it has saved the `wanted` entities."""
    nothing = subprocess.DEVNULL
    process = subprocess.Popen(
        [rerun_tool(), "--save", str(path), source], stdin=nothing, stdout=nothing, stderr=nothing
    )
    try:
        wait_until(lambda: wanted <= entities(path), f"rerun has written {wanted}")
    finally:
        process.kill()  # Asked to end, it would wait for the end of the run.
        process.wait()


def entities(path: Path) -> set[str]:
    """The entities in a file that may still grow, without a message that is not complete yet."""
    found: set[str] = set()
    with contextlib.suppress(ValueError, RuntimeError), quiet_reader(path) as reader:
        for chunk in reader.stream():
            found.add(chunk.entity_path)
    return found


def test_rerun_watches_a_shared_lab_through_the_front_server(open_another: Callable[..., FrontServer], tmp_path: Path):
    before = listening()
    front_server = open_another(rerun=True, token=TOKEN)
    (lab,) = front_server.places.running()
    assert listening() - before == {front_server.port, lab.port}, "rerun has no port of its own"
    watch(front_server.live_source, tmp_path / "seen.rrd", {"/scene/beam", "/error", "/parameters"})


def test_live_data_need_the_token_or_a_pass_to_this_lab(open_another: Callable[..., FrontServer]):
    front_server = open_another(rerun=True, token=TOKEN)
    assert ask(front_server.url, "/live/lab.rrd", "HEAD").status == 401
    assert ask(front_server.url, f"/pass/{'0' * 64}/live/lab.rrd", "HEAD").status == 401
    path = urlsplit(front_server.live_source).path
    assert ask(front_server.url, path.replace("lab.rrd", "other.rrd"), "HEAD").status == 401
    assert ask(front_server.url, path, "HEAD").status == 200
    signed_in = ask(front_server.url, f"/?token={TOKEN}").cookies
    shown = ask(front_server.url, "/live", cookies=signed_in)
    assert shown.status == 303
    assert parse_qs(urlsplit(shown.headers["Location"]).query)["url"][0].endswith(path)


def test_without_the_option_there_are_no_live_data(front_server: FrontServer):
    assert ask(front_server.url, "/live").status == 404
    assert ask(front_server.url, "/live/lab.rrd").status == 404
    state = ask(front_server.url, "/state/lab").text
    assert '"live": ""' in state


def test_a_foreign_host_name_or_page_gets_no_live_data(open_another: Callable[..., FrontServer]):
    front_server = open_another(rerun=True)
    for origin in ({}, {"Origin": "http://evil.example"}):
        assert ask(front_server.url, "/live/lab.rrd", "HEAD", Host="evil.example", **origin).status == 403
    answer = ask(front_server.url, "/live/lab.rrd", "HEAD", Origin="http://evil.example")
    assert (answer.status, answer.headers["Access-Control-Allow-Origin"]) == (200, None), "no other page may read it"
    assert answer.headers["Cross-Origin-Resource-Policy"] == "same-origin"


def test_only_the_visitor_of_a_private_lab_gets_its_live_data(open_another: Callable[..., FrontServer], tmp_path: Path):
    before = listening()
    front_server = open_another(rerun=True, private=True, max_sessions=1)
    answer = ask(front_server.url, "/lab/")
    (lab,) = front_server.places.running()
    assert listening() - before == {front_server.port, lab.port}
    assert ask(front_server.url, "/live").status == 404, "somebody else has no lab"
    assert ask(front_server.url, "/live/lab.rrd").status == 404
    shown = ask(front_server.url, "/live", cookies=answer.cookies)
    (source,) = parse_qs(urlsplit(shown.headers["Location"]).query)["url"]
    watch(source, tmp_path / "seen.rrd", {"/scene/beam", "/error"})
