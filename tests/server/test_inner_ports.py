"""The ports of the labs themselves answer the front server only."""

from collections.abc import Callable

import psutil
import pytest
from http_client import ask, upgrade, wait_until

from flexlab.lab.viser_server import SECRET_HEADER
from flexlab.server.front_server import FrontServer

FOREIGN = {"Origin": "http://evil.example", "Host": "evil.example"}


def inside(front_server: FrontServer) -> str:
    (place,) = front_server.places.running()
    return f"http://127.0.0.1:{place.port}"


def test_only_two_ports_are_open_and_both_on_loopback(open_another: Callable[..., FrontServer]):
    before = {c.laddr for c in psutil.Process().net_connections(kind="inet") if c.status == psutil.CONN_LISTEN}
    front_server = open_another()
    after = {c.laddr for c in psutil.Process().net_connections(kind="inet") if c.status == psutil.CONN_LISTEN}
    (place,) = front_server.places.running()
    assert {address.port for address in after - before} == {front_server.port, place.port}
    assert {address.ip for address in after - before} == {"127.0.0.1"}


@pytest.mark.parametrize("headers", [{}, FOREIGN, {SECRET_HEADER: ""}, {SECRET_HEADER: "guess"}, {SECRET_HEADER: "ä"}])
def test_the_lab_answers_nobody_without_the_secret(front_server: FrontServer, headers: dict[str, str]):
    headers = {name.replace("-", "_"): value.encode().decode("latin-1") for name, value in headers.items()}
    page = ask(inside(front_server), "/", **headers)
    assert (page.status, "inside of a lab" in page.text) == (403, True)
    assert ask(inside(front_server), "/lab", **upgrade(), **headers).status == 403
    assert ask(front_server.url, "/lab/").status == 200
    assert ask(front_server.url, "/lab", **upgrade()).status == 101


def test_private_labs_answer_nobody_without_their_secret(open_another: Callable[..., FrontServer]):
    front_server = open_another(private=True, max_sessions=1)
    answer = ask(front_server.url, "/lab/")
    (place,) = wait_until(front_server.places.running, "the lab runs")
    assert ask(f"http://127.0.0.1:{place.port}", place.path, **upgrade()).status == 403
    assert ask(front_server.url, place.path, cookies=answer.cookies, **upgrade()).status == 101
