"""The addresses and QR codes that a class is given, and the panel's sentence about the recording."""

import ipaddress
from pathlib import Path

from flexlab.server.labs.recorded_lab import LITTLE_SPACE, RecordingText
from flexlab.server.settings import Settings, network_addresses, picture_code, terminal_code


def test_network_addresses_are_neither_loopback_nor_unspecified() -> None:
    for address in network_addresses():
        number = ipaddress.ip_address(address)
        assert not number.is_loopback
        assert not number.is_unspecified


def test_a_lab_for_this_machine_only_has_no_outside_addresses(tmp_path: Path) -> None:
    assert Settings(tmp_path).outside_addresses(8080) == []


def test_the_outside_address_has_the_given_host_and_the_token(tmp_path: Path) -> None:
    settings = Settings(tmp_path, "192.0.2.7", token="wordwordwordword")
    assert settings.outside_addresses(8080, "/lab/") == ["http://192.0.2.7:8080/lab/?token=wordwordwordword"]


def test_qr_codes_come_as_text_and_as_a_picture() -> None:
    lines = terminal_code("http://192.0.2.7:8080/lab/?token=wordwordwordword").splitlines()
    assert len(lines) > 10
    assert picture_code("http://192.0.2.7:8080/lab/").startswith("data:image/svg+xml")


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
