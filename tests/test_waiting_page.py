"""A first start shows a page at once, which programs do not mistake for the lab."""

import socket
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from flexlab.cli.showing import waiting_page
from flexlab.sockets import base_address, free_ports


@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0", "::1", "::"])
def test_programs_are_told_that_the_lab_is_not_there_yet(host: str):
    [port] = free_ports(1)
    with waiting_page(host, port), pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(base_address(host, port) + "/any/path")
    assert caught.value.code == 503
    assert "compiling the equations of motion" in caught.value.read().decode()


def test_the_port_is_free_again_after_the_page():
    [port] = free_ports(1)
    for _ in range(2):
        with waiting_page("127.0.0.1", port):
            pass


def test_a_hub_finds_the_page_on_the_socket_where_the_lab_will_be(tmp_path: Path):
    for _ in range(2):  # It also leaves the socket free for the next server.
        with waiting_page(f"unix:{tmp_path / 's'}", 0), socket.socket(socket.AF_UNIX) as hub:
            hub.connect(str(tmp_path / "s"))
            hub.sendall(b"GET /user/ann/flexlab/lab/ HTTP/1.0\r\n\r\n")
            answer = hub.makefile("rb").read().decode()
        assert answer.splitlines()[0].split()[1] == "503"
        assert "compiling the equations of motion" in answer
