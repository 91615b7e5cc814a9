"""The addresses and QR codes that a class is given, and the panel's sentence about the recording."""

import re
from pathlib import Path
from urllib.parse import unquote

import pytest
import segno

from flexlab.server.labs.recorded_lab import LITTLE_SPACE, RecordingText
from flexlab.server.settings import Settings, network_addresses, picture_code, terminal_code


def test_network_addresses_are_those_that_other_machines_can_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    own = "127.0.0.1", "192.0.2.7", "0.0.0.0", "169.254.1.1", "192.0.2.7", "::1", "2001:db8::7", "fe80::1%eth0", "::"
    monkeypatch.setattr("flexlab.server.settings.FAR_AWAY", {})
    monkeypatch.setattr("socket.getaddrinfo", lambda *_: [(0, 0, 0, "", (address, 0)) for address in own])
    assert network_addresses() == ["192.0.2.7", "2001:db8::7"]


def test_a_lab_for_this_machine_only_has_no_outside_addresses(tmp_path: Path) -> None:
    assert Settings(tmp_path).outside_addresses(8080) == []


def test_the_outside_address_has_the_given_host_and_the_token(tmp_path: Path) -> None:
    settings = Settings(tmp_path, "192.0.2.7", token="wordwordwordword")
    assert settings.outside_addresses(8080, "/lab/") == ["http://192.0.2.7:8080/lab/?token=wordwordwordword"]


def test_qr_codes_as_text_and_as_a_picture_hold_the_address() -> None:
    address = "http://192.0.2.7:8080/lab/?token=wordwordwordword"
    squares = segno.make(address, micro=False).matrix
    dark = {(row, column) for row, line in enumerate(squares) for column, square in enumerate(line) if square}
    written, drawn = set(), set()
    for row, line in enumerate(terminal_code(address).splitlines()):
        for column, mark in enumerate(line):  # One light square as a border; two rows of squares in each line.
            written |= {(2 * row + half - 1, column - 1) for half in (0, 1) if mark not in ("█▀", "█▄")[half]}
    assert {place for place in written if place[0] <= len(squares)} == dark
    x = y = 0
    path = unquote(picture_code(address)).rpartition(" d='")[2]
    for kind, along, down in re.findall(r"([Mmh])(-?\d+)(?: (-?[\d.]+))?", path):
        if kind == "h":
            drawn |= {(y - 2, x - 2 + square) for square in range(int(along))}
        x, y = (0 if kind == "M" else x) + int(along), y + int(float(down or 0))
    assert drawn == dark


class Growing:
    """A recorder whose file grows by a megabyte a second."""

    problem = None

    def __init__(self, path: Path):
        self.path = path


def test_the_recording_rate_leaves_out_waiting_and_pauses(tmp_path: Path) -> None:
    now, size = [0.0], [0]
    recorder = Growing(tmp_path / "run.rrd")
    text = RecordingText(recorder, tmp_path, clock=lambda: now[0])  # type: ignore[arg-type]
    said = []
    for second in range(40):
        now[0] = float(second)
        # A run waits until its page is drawn, plays for fifteen seconds, and is paused.
        size[0] += 1_000_000 if 3 < second < 20 else 0
        recorder.path.write_bytes(b"x" * size[0])
        said.append(text().removeprefix("Recording to run.rrd"))
    assert set(said[:5]) == {""}
    assert set(said[5:20]) == {", 60 MB/min"}
    assert set(said[23:]) == {""}, "nothing is written"


def test_the_recording_rate_is_measured_and_little_space_is_warned_of(tmp_path: Path, monkeypatch) -> None:
    now = [0.0]
    recorder = Growing(tmp_path / "run.rrd")
    text = RecordingText(recorder, tmp_path, clock=lambda: now[0])  # type: ignore[arg-type]
    for second in range(5):
        now[0] = float(second)
        recorder.path.write_bytes(b"x" * (1_000_000 * second))
        said = text()
    assert said.startswith("Recording to run.rrd, 60 MB/min")
    usage = type("Usage", (), {"free": LITTLE_SPACE / 2})
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage)
    now[0] += 1.0
    assert "Only 1.0 GB free on this disk" in text()
