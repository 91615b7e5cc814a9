"""`flexlab` as a person starts it: serves a page, records, ends on Ctrl-C, refuses what it cannot do."""

import re
import signal
import socket
import subprocess
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest
from lab_process import Lab, answer

Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_the_lab_serves_records_and_ends(start_lab: Callable[..., Lab], how: signal.Signals):
    lab = start_lab("--preset", "soft-beam")
    with urllib.request.urlopen(lab.url()) as page:
        assert page.status == 200
    lab.wait(lab.recordings)
    assert lab.end(how) == 0, lab.complained
    assert "Traceback" not in "".join(lab.complained)
    (file,) = lab.recordings()
    assert file.name.endswith("-soft-beam.rrd")
    assert str(Path("logs") / file.name) in "".join(lab.said)


def test_a_busy_port_is_one_sentence(flexlab_process: Command, tmp_path: Path):
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        done = flexlab_process("--no-browser", "--port", str(port))
    assert done.returncode == 2
    assert str(port) in done.stderr
    assert "in use" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.rglob("*.rrd")) == []


def test_a_second_lab_on_the_same_port_is_refused_and_the_first_goes_on(
    start_lab: Callable[..., Lab], flexlab_command: Command
):
    lab = start_lab()
    url = lab.url()
    done = flexlab_command("--no-browser", "--port", str(lab.port()))
    assert done.returncode == 2
    assert "in use" in done.stderr
    with urllib.request.urlopen(url) as page:
        assert page.status == 200


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--preset", "papr"], "did you mean paper?"),
        (["--preset", "none.json"], "no scenario file"),
        (["--port", "99999"], "99999"),
        (["--host", "256.1.1.1"], "256.1.1.1"),
        (["--host", "192.0.2.1"], "192.0.2.1"),
        (["--logs", "/proc/logs"], "/proc/logs"),
        (["--max-sessions", "0"], "max-sessions = 0"),
        (["--token", "abc"], "16 characters"),
    ],
)
def test_bad_input_is_one_sentence(flexlab_command: Command, words: list[str], says: str):
    done = flexlab_command("--no-browser", "--port", "0", *words)
    assert done.returncode == 2, done.stderr
    assert says in done.stderr
    assert "Traceback" not in done.stderr
    assert done.stdout == ""


def test_live_data_is_offered_with_rerun(start_lab: Callable[..., Lab]):
    lab = start_lab("--rerun")
    lab.url()
    page = lab.wait(lambda: re.search(r"Live data in your browser: (http://\S+/live)", "".join(lab.said)))[1]
    with urllib.request.urlopen(page) as viewer:
        assert viewer.status == 200
    source = lab.wait(lambda: re.search(r"rerun (http://\S+/live/lab\.rrd)", "".join(lab.said)))[1]
    with urllib.request.urlopen(source) as data:
        assert data.read(4) == b"RRF2"
    assert lab.end() == 0


def test_a_lab_for_others_asks_for_its_token(start_lab: Callable[..., Lab]):
    lab = start_lab("--host", "0.0.0.0")
    url = lab.url()
    assert "?token=" in url
    assert answer(url) == 200
    assert answer(url.split("?")[0]) == 401
    assert lab.end() == 0


def test_private_labs_open_and_close(start_lab: Callable[..., Lab]):
    lab = start_lab("--private", "--max-sessions", "1")
    assert answer(lab.url()) == 200
    assert lab.end() == 0
    assert "Traceback" not in "".join(lab.complained)
