"""The archive of a run: one file that another machine can verify, and in which any change is noticed."""

import errno
import hashlib
import json
import os
import shutil
import zipfile
from pathlib import Path

import pytest
from lab_process import Command
from own_path_text import ROUND

import flexlab
from flexlab.analysis import capsule as capsules
from flexlab.analysis.capsule import METADATA, RUN, unpack_capsule, write_capsule
from flexlab.errors import RecordingError, StudyError
from flexlab.recording.headless import HeadlessRecording
from flexlab.recording.reader import read_recording
from flexlab.recording.run_info import RunInfo
from flexlab.sim.commands import Tap
from flexlab.sim.samples import Status
from flexlab.sim.snapshot import Event


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recorded run with a tap in it."""
    tap = Tap(0.05, (0.0, 0.1))
    run = flexlab.simulate("paper", 0.3, commands=[(0.1, tap)])
    with HeadlessRecording(tmp_path_factory.mktemp("logs"), RunInfo("paper", run.scenario)) as recording:
        recording.write(run.slice(0, 101))
        recording.note(Event(0.1, "tap", tap))
        recording.write(run.slice(101, 301))
        recording.end(run.status)
    return recording.path


@pytest.fixture(scope="module")
def capsule(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    target = tmp_path_factory.mktemp("capsule") / "run.zip"
    write_capsule(source, target)
    return target


def test_the_archive_holds_the_run_and_describes_every_file(source: Path, capsule: Path, tmp_path: Path):
    with zipfile.ZipFile(capsule) as archive:
        names = set(archive.namelist())
        crate = json.loads(archive.read(METADATA))
        files = {item["@id"]: item for item in crate["@graph"] if item["@type"] == "File"}
        assert set(files) == names - {METADATA}
        for name, item in files.items():
            data = archive.read(name)
            assert (item["sha256"], item["contentSize"]) == (hashlib.sha256(data).hexdigest(), str(len(data)))
        assert {f"figures/run-figure-{number}.svg" for number in (2, 3, 4, 5)} < names
        commands = json.loads(archive.read("commands.json"))
        metrics = json.loads(archive.read("metrics.json"))
    assert crate["@context"] == "https://w3id.org/ro/crate/1.1/context"
    root = next(item for item in crate["@graph"] if item["@id"] == "./")
    assert {part["@id"] for part in root["hasPart"]} == set(files)
    assert commands[0]["command"] == {"kind": "Tap", "beam_position": 0.05, "impulse": [0.0, 0.1]}
    assert metrics["result_hash"] == flexlab.read(source).result_hash
    unpacked = unpack_capsule(capsule, tmp_path)
    assert unpacked.read_bytes() == source.read_bytes()
    assert read_recording(unpacked).name == "paper"
    again = tmp_path / "again.zip"
    write_capsule(source, again)
    assert again.read_bytes() == capsule.read_bytes()


def test_the_archive_of_a_run_that_failed_has_no_metrics_no_date_and_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("flexlab.analysis.capsule.paper_figures", lambda *_: None)  # They take seconds.
    (tmp_path / "round.py").write_text(ROUND, encoding="utf-8")
    run = flexlab.simulate("paper", 0.05, path=tmp_path / "round.py")
    with HeadlessRecording(tmp_path, RunInfo("paper", run.scenario)) as recording:
        recording.write(run)
        recording.note(Event(0.05, "The run diverged."))
        recording.end(Status("diverged", "The run diverged."))
    write_capsule(recording.path, tmp_path / "run.zip")
    with zipfile.ZipFile(tmp_path / "run.zip") as archive:
        assert {about.date_time for about in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
        assert archive.read("path.py").decode() == run.scenario.trajectory.source
        assert json.loads(archive.read("commands.json")) == []
        metrics = json.loads(archive.read("metrics.json"))
    assert (metrics["duration"], metrics["peak_torque"]) == (0.05, None)


def test_a_changed_archive_is_refused(capsule: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with zipfile.ZipFile(capsule) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}

    def changed(**others: bytes | None) -> Path:
        path = tmp_path / "changed.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for name, data in {**members, **others}.items():
                if data is not None:
                    archive.writestr(name, data)
        return path

    for name in (RUN, "scenario.json", "figures/run-figure-2.svg"):
        with pytest.raises(RecordingError, match="was changed or is missing"):
            unpack_capsule(changed(**{name: members[name] + b" "}), tmp_path)
        with pytest.raises(RecordingError, match="was changed or is missing"):
            unpack_capsule(changed(**{name: None}), tmp_path)
    with pytest.raises(RecordingError, match="is not an archive of a run"):
        unpack_capsule(changed(**{METADATA: None}), tmp_path)
    for junk in (b"[]", b"{", b'{"@graph": 3}', b'{"@graph": []}'):
        with pytest.raises(RecordingError, match="archive of a run"):
            unpack_capsule(changed(**{METADATA: junk}), tmp_path)
    junk_file = tmp_path / "junk.zip"
    junk_file.write_bytes(b"junk" * 100)
    with pytest.raises(RecordingError, match="cannot be read as an archive"):
        unpack_capsule(junk_file, tmp_path)
    with pytest.raises(RecordingError, match="There is no file"):
        unpack_capsule(tmp_path / "none.zip", tmp_path)


def test_an_archive_is_not_unpacked_beyond_all_bounds(capsule: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with zipfile.ZipFile(capsule) as archive:
        sizes = {about.filename: about.file_size for about in archive.infolist()}
    sizes_of_disk = shutil.disk_usage(tmp_path)
    (tmp_path / "unpacked").mkdir()
    for what, size, change in (
        (f"{METADATA} has", sizes[METADATA], lambda most: monkeypatch.setattr(capsules, "LARGEST_METADATA", most)),
        ("unpacked, has", sum(sizes.values()), lambda most: monkeypatch.setattr(capsules, "LARGEST_ARCHIVE", most)),
        (
            f"{RUN} has",
            sizes[RUN],
            lambda most: monkeypatch.setattr(shutil, "disk_usage", lambda _: sizes_of_disk._replace(free=most)),
        ),
    ):
        change(1000)
        with pytest.raises(RecordingError, match=rf"{what} .*B, more than the 1 kB that are (unpacked\.|free in )"):
            unpack_capsule(capsule, tmp_path / "unpacked")
        assert not list((tmp_path / "unpacked").iterdir())
        change(size)
    assert unpack_capsule(capsule, tmp_path / "unpacked").stat().st_size == sizes[RUN]


def test_the_archive_is_written_whole_or_not_at_all(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match="cannot be written"):
        write_capsule(source, tmp_path / "file" / "run.zip")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    write, room = zipfile.ZipFile.writestr, iter(range(3))

    def onto_a_small_disk(archive: zipfile.ZipFile, *words: object) -> None:
        if next(room, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(archive, *words)

    monkeypatch.setattr(zipfile.ZipFile, "writestr", onto_a_small_disk)
    with pytest.raises(StudyError, match="No space left on device"):
        write_capsule(source, tmp_path / "file")
    assert next(room, None) is None, "it broke off on the way"
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("file", b"")]


def test_export_writes_the_archive_and_replay_verifies_it(flexlab_command: Command, source: Path, tmp_path: Path):
    done = flexlab_command("export", str(source), "--to", "mine.zip")
    assert done.returncode == 0, done.stderr
    replayed = flexlab_command("replay", "mine.zip")
    assert replayed.returncode == 0, replayed.stderr
    assert "bit for bit" in replayed.stdout
    data = bytearray((tmp_path / "mine.zip").read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "mine.zip").write_bytes(bytes(data))
    refused = flexlab_command("replay", "mine.zip")
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    page = flexlab_command("export", str(source), "--to", "mine.html")
    assert page.returncode == 0, page.stderr
    assert page.stdout.startswith("mine.html")
    assert (tmp_path / "mine.html").stat().st_size < 3e6
