"""`flexlab` as a user starts it: serves a page, records, ends on Ctrl-C, refuses what it cannot do."""

import re
import signal
import socket
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest
from lab_process import Command, Lab, answer, refused


def recording_of_the_ended(lab: Lab, how: signal.Signals) -> Path:
    """End a lab once it has recorded something; return the recording that it names."""
    lab.wait(lab.recordings)
    assert lab.end(how) == 0, lab.complained
    assert "Traceback" not in "".join(lab.complained)
    (file,) = lab.recordings()
    assert str(Path("logs") / file.name) in "".join(lab.said)
    return file


def test_the_lab_serves_records_and_ends_and_a_second_one_on_its_port_is_refused(
    start_lab: Callable[..., Lab], flexlab_command: Command
):
    lab = start_lab("--preset", "soft-beam", "--rerun")
    url = lab.url()
    assert "in use" in refused(flexlab_command("--no-browser", "--port", str(lab.port())))
    assert answer(url) == 200
    live = lab.wait(lambda: re.search(r"Live data in your browser: (http://\S+/live)", "".join(lab.said)))[1]
    assert answer(live) == 200
    source = lab.wait(lambda: re.search(r"rerun (http://\S+/live/lab\.rrd)", "".join(lab.said)))[1]
    with urllib.request.urlopen(source) as data:
        assert data.read(4) == b"RRF2"
    assert recording_of_the_ended(lab, signal.SIGINT).name.endswith("-soft-beam.rrd")


def test_a_lab_with_a_token_prints_a_secret_address_for_the_teacher_and_with_nohup_outlives_its_terminal(
    start_lab: Callable[..., Lab],
):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # As nohup does; the lab inherits it.
    try:
        lab = start_lab("--token", "the-word-of-the-class")
    finally:
        signal.signal(signal.SIGHUP, before)
    url = lab.url()
    assert answer(url) == 200
    page = lab.wait(lambda: re.search(r"for the teacher: (http://\S+)", "".join(lab.said)))[1]
    assert answer(page) == 200
    assert answer(page.replace(page.partition("=")[2], "the-word-of-the-class")) == 401
    lab.wait(lambda: "Ctrl-C ends the lab." in "".join(lab.said))
    lab.process.send_signal(signal.SIGHUP)
    lab.process.send_signal(signal.SIGCONT)
    assert answer(url) == 200
    recording_of_the_ended(lab, signal.SIGTERM)


def test_a_busy_port_is_one_sentence(flexlab_command: Command, tmp_path: Path):
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        said = refused(flexlab_command("--no-browser", "--port", str(port)))
    assert str(port) in said
    assert "in use" in said
    assert list(tmp_path.rglob("*.rrd")) == []


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--preset", "papr"], "did you mean paper?"),
        (["--preset", "none.json"], "no scenario file"),
        (["--port", "99999"], "99999"),
        (["--host", "256.1.1.1"], "256.1.1.1"),
        (["--host", "192.0.2.1"], "192.0.2.1"),
        (["--logs", "/proc/logs"], "/proc/logs"),
        (["--private", "--max-sessions", "0"], "max-sessions = 0"),
        (["--max-sessions", "4"], "--max-sessions is for private labs: add --private"),
        (["--max-per-address", "4"], "--max-per-address is for private labs"),
        (["--idle-time", "600"], "--idle-time is for private labs"),
        (["--quota", "50"], "--quota is for private labs"),
        (["--token", "abc"], "--token has 3 characters, too few to keep anybody out: give at least 16"),
    ],
)
def test_bad_input_is_one_sentence(flexlab_command: Command, words: list[str], says: str):
    assert says in refused(flexlab_command("--no-browser", *(["--port", "0"] if "--port" not in words else []), *words))


def test_private_labs_for_others_open_with_their_token_only_and_close(start_lab: Callable[..., Lab]):
    lab = start_lab("--host", "0.0.0.0", "--private", "--max-sessions", "1")
    url = lab.url()
    assert "?token=" in url
    assert answer(url) == 200
    assert answer(url.split("?")[0]) == 401
    assert lab.end() == 0
    assert "Traceback" not in "".join(lab.complained)
