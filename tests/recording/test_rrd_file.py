"""Writing to a disk that may be full: only whole messages are written, and nothing is lost that can be kept."""

import os
import threading
from itertools import accumulate
from pathlib import Path

import pytest
import rerun as rr

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.chunks import stream_rows
from flexlab.recording.rerun_internals.rrd_file import Pipe, RrdFile, messages


class Narrow:
    """A disk that takes `room` more bytes; then `os.write` raises the error of a full disk."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, room: int):
        self.room, self._write = room, os.write
        monkeypatch.setattr(os, "write", self.write)

    def write(self, descriptor: int, data: bytes) -> int:
        if self.room == 0:
            raise OSError(28, "No space left on device")
        written = self._write(descriptor, data[: self.room])
        self.room -= written
        return written


@pytest.fixture
def pieces() -> list[bytes]:
    """Twenty pieces as rerun encodes them, each with its own text."""
    stream = rr.RecordingStream("test", recording_id="one")
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    encoded = stream.binary_stream()
    found = []
    for number in range(20):
        stream.set_time("sim_time", duration=float(number))
        stream.log("note", rr.TextLog(f"number {number}"))
        found.append(encoded.read() or b"")
    stream.disconnect()
    return found


def notes(path: Path) -> list[str]:
    return [row["text"] for _, (_, row) in stream_rows(path, ["/note"])]


def test_pieces_make_one_file_that_rerun_reads(pieces: list[bytes], tmp_path: Path) -> None:
    path = tmp_path / "x.rrd"
    with path.open("wb", buffering=0) as handle:
        file = RrdFile(handle)
        for piece in pieces:
            file.hold(piece)
            file.write()
    assert notes(path) == [f"number {number}" for number in range(20)]


@pytest.mark.parametrize("room", [0, 1, 500, 5000])
def test_a_full_disk_leaves_whole_messages_and_the_rest_follows(
    pieces: list[bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    path = tmp_path / "x.rrd"
    beginnings = list(accumulate((messages(piece, piece is pieces[0]) for piece in pieces), initial=b""))
    disk = Narrow(monkeypatch, room)
    with path.open("wb", buffering=0) as handle:
        file = RrdFile(handle)
        failures = 0
        for piece in pieces:
            file.hold(piece)
            try:
                file.write()
            except RecordingError:
                failures += 1
        assert failures > 0
        assert path.read_bytes() in beginnings
        disk.room = 10**9
        file.write()
    assert notes(path) == [f"number {number}" for number in range(20)]
    assert file.given_up == 0


@pytest.mark.parametrize("begun", [True, False])
def test_a_disk_that_stays_full_loses_the_oldest_pieces_but_never_the_first(
    pieces: list[bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begun: bool
) -> None:
    path = tmp_path / "x.rrd"
    disk = Narrow(monkeypatch, 10**9 if begun else 0)
    with path.open("wb", buffering=0) as handle:
        file = RrdFile(handle, held_bytes=3 * len(pieces[5]))
        for number, piece in enumerate(pieces):
            file.hold(piece)
            if begun and number == 3:
                file.write()
                disk.room = 0
        with pytest.raises(RecordingError, match="No space left on device"):
            file.write()
        disk.room = 10**9
        file.write()
    found = notes(path)
    assert found[0] == "number 0"
    assert found[-1] == "number 19"
    assert len(found) == 20 - file.given_up
    assert 0 < file.given_up < 16


def test_pieces_of_another_version_of_rerun_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "x.rrd").open("wb", buffering=0) as handle, pytest.raises(RecordingError, match="needs rerun-sdk"):
        RrdFile(handle).hold(b"RRF9 and so on")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes")
def test_a_pipe_that_rerun_never_opened_is_closed_at_once(tmp_path: Path):
    def close_many() -> None:
        with (tmp_path / "run.rrd").open("wb", buffering=0) as file:
            for _ in range(300):
                Pipe(file).close()

    closing = threading.Thread(target=close_many, daemon=True)
    closing.start()
    closing.join(60)
    assert not closing.is_alive()
