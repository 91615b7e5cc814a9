"""Every spelling of a host stands for the same address, and a Unix socket replaces nothing but an old one."""

import socket
import sys
from pathlib import Path

import pytest

from flexlab.errors import LabError
from flexlab.server.settings import Settings
from flexlab.sockets import LOOPBACK, WILDCARDS, base_address, listen, usual_spelling


@pytest.mark.parametrize(
    "host", ["0.0.0.0", "0", "0x0", "0.0", "00000", "*", "::ffff:0.0.0.0", "::", "[::]", "::0", "0:0:0:0:0:0:0:0"]
)
def test_the_wildcard_address_is_known_in_every_spelling(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexlab.server.settings.network_addresses", lambda: ["192.0.2.7", "2001:db8::7"])
    assert usual_spelling(host) in WILDCARDS
    settings = Settings(host=host, token="wordwordwordword")
    assert not settings.is_local
    assert settings.public_host() == "192.0.2.7"
    names = ["192.0.2.7"] if settings.host == "0.0.0.0" else ["192.0.2.7", "[2001:db8::7]"]
    assert settings.outside_addresses(8080, "/") == [f"http://{name}:8080/?token=wordwordwordword" for name in names]


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1", "2130706433", "0x7f.1", "::ffff:127.0.0.1", "[::1]", "::1"])
def test_loopback_is_known_in_every_spelling(host: str) -> None:
    assert usual_spelling(host) in LOOPBACK
    assert Settings(host=host).is_local


@pytest.mark.parametrize("host", ["localhost", "lab.example", "192.0.2.7", "2001:db8::7", "unix:[x]", "[", "[]", "%"])
def test_names_and_other_addresses_stay_as_they_are(host: str) -> None:
    assert usual_spelling(host) == host


@pytest.mark.parametrize(
    ("host", "name"), [("::1", "[::1]"), ("[::1]", "[::1]"), ("::", "127.0.0.1"), ("*", "127.0.0.1")]
)
def test_the_address_of_a_server_is_one_that_a_browser_opens(host: str, name: str) -> None:
    assert base_address(usual_spelling(host), 8080) == f"http://{name}:8080"


@pytest.mark.parametrize(
    ("host", "port", "said"), [("127.0.0.1", 70000, "not a port number"), ("192.0.2.1", 0, "192.0.2.1")]
)
def test_an_address_that_cannot_be_used_is_explained(host: str, port: int, said: str) -> None:
    with pytest.raises(LabError, match=said):
        listen(host, port)


@pytest.mark.parametrize(
    "host", ["x" * 64 + ".invalid", "256.1.1.1", "a..invalid", "\udcff.invalid", "[::1", "0.0.0.0."]
)
def test_an_impossible_host_is_one_sentence(host: str) -> None:
    with pytest.raises(LabError, match=r"is not an address of this machine: use 127\.0\.0\.1 or 0\.0\.0\.0"):
        listen(host, 0)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no Unix sockets")
def test_a_unix_socket_replaces_one_that_nobody_listens_on_and_no_other_file(tmp_path: Path) -> None:
    file, left = tmp_path / "thesis.txt", tmp_path / "left"
    file.write_text("a year of work")
    with pytest.raises(LabError, match=r"thesis\.txt is a file, not a socket"):
        listen(f"unix:{file}", 0)
    assert file.read_text() == "a year of work"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as killed:
        killed.bind(str(left))
    with listen(f"unix:{left}", 0), pytest.raises(LabError, match="in use by another program"):
        listen(f"unix:{left}", 0)
