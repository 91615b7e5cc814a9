"""Exported runs that were tampered with, and full disks: each is refused in one sentence, and nothing is left behind."""

import json
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from exported import export_run
from recording_helpers import start_script

from flexlab import machine
from flexlab.analysis.capsule import METADATA, unpack_capsule
from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.importing import import_into
from flexlab.recording.reader import read_recording
from flexlab.sim.simulate import simulate

LOCAL, CENTRAL = b"PK\x03\x04", b"PK\x01\x02"
"""First bytes of the two headers that an archive has for each of its files."""


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A good archive."""
    run = simulate(load_preset("paper"), duration=0.1)
    return export_run(run, tmp_path_factory.mktemp("exported") / "good.npz")


def refused(read: Callable[..., object], path: Path, folder: Path, sentence: str) -> None:
    """Check that reading a file into a folder raises an error of one sentence, and leaves nothing there."""
    with pytest.raises(RecordingError, match=sentence) as caught:
        read(path, folder)
    said = str(caught.value)
    assert "\n" not in said, said
    assert len(said) < 600, said
    assert not list(folder.glob("*"))


def heads(data: bytearray, mark: bytes) -> list[int]:
    return [at for at in range(len(data)) if data.startswith(mark, at)]


def locked(data: bytearray) -> None:
    for mark, at in ((LOCAL, 6), (CENTRAL, 8)):
        for head in heads(data, mark):
            data[head + at] |= 1


def packed_by(method: int) -> Callable[[bytearray], None]:
    def change(data: bytearray) -> None:
        for mark, at in ((LOCAL, 8), (CENTRAL, 10)):
            for head in heads(data, mark):
                data[head + at] = method

    return change


def torn(data: bytearray) -> None:
    name, extra = struct.unpack("<HH", data[26:30])
    begin = 30 + name + extra
    data[begin : begin + 40] = b"\xff" * 40


@pytest.mark.parametrize("change", [locked, torn, packed_by(1), packed_by(93), packed_by(99)])
@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_an_odd_archive_is_refused_in_one_sentence(
    exported: Path, tmp_path: Path, change: Callable[[bytearray], None], method: int
) -> None:
    path = tmp_path / "odd.npz"
    with zipfile.ZipFile(exported) as good, zipfile.ZipFile(path, "w", method) as archive:
        for name in good.namelist():
            archive.writestr(name, good.read(name))
    data = bytearray(path.read_bytes())
    change(data)
    path.write_bytes(data)
    refused(import_into, path, tmp_path / "logs", r"odd\.npz is not a run exported by flexlab")


@pytest.mark.parametrize(
    "shape", ["(10**12,)", "(1000000000000,)", "(1000000, 1000000, 1000000)", "(-1,)", "('a',)", "(" * 300 + ")" * 300]
)
def test_an_array_with_a_false_shape_is_refused(exported: Path, tmp_path: Path, shape: str) -> None:
    path = tmp_path / "odd.npz"
    words = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(1013).encode() + b"\n"
    with zipfile.ZipFile(exported) as good, zipfile.ZipFile(path, "w") as archive:
        for number, name in enumerate(good.namelist()):
            lies = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(words)) + words + bytes(800)
            archive.writestr(name, lies if number == 0 else good.read(name))
    refused(import_into, path, tmp_path / "logs", r"odd\.npz is not a run exported by flexlab")


def change_metadata(exported: Path, path: Path, text: str) -> Path:
    with np.load(exported) as file:
        arrays = {name: file[name] for name in file.files}
    np.savez(path, **arrays | {"flexlab": np.array(text)})
    return path


@pytest.mark.parametrize("text", ["[" * 100_000, '{"scenario":' * 50_000, "[1]", "null", "NaN"])
def test_metadata_of_the_wrong_form_are_refused(exported: Path, tmp_path: Path, text: str) -> None:
    path = change_metadata(exported, tmp_path / "odd.npz", text)
    refused(import_into, path, tmp_path / "logs", "is not a run exported by flexlab")


@pytest.mark.parametrize("change", [bytearray.clear, locked, torn, packed_by(1), packed_by(99)])
@pytest.mark.parametrize("text", ["[" * 100_000, "[1]", '{"@graph":[{"@id":[],"@type":"File","sha256":1}]}'])
def test_an_odd_capsule_is_refused(tmp_path: Path, change: Callable[[bytearray], None], text: str) -> None:
    path = tmp_path / "odd.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(METADATA, text)
    refused(unpack_capsule, path, tmp_path / "unpacked", r"odd\.zip cannot be read as an archive of a run")
    data = bytearray(path.read_bytes())
    change(data)
    path.write_bytes(data)
    refused(unpack_capsule, path, tmp_path / "unpacked", r"odd\.zip cannot be read as an archive of a run")


def understated(path: Path, name: str, data: bytes, says: int) -> Path:
    """An archive of one file with `data`, which says that it unpacks to `says` bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, data)
    packed = bytearray(path.read_bytes())
    for mark, at in ((LOCAL, 22), (CENTRAL, 24)):
        (head,) = heads(packed, mark)
        struct.pack_into("<I", packed, head + at, says)
    path.write_bytes(packed)
    return path


@pytest.mark.parametrize(("name", "read"), [(METADATA, unpack_capsule), ("time.npy", import_into)])
def test_no_more_is_unpacked_than_an_archive_says(tmp_path: Path, name: str, read: Callable[..., object]) -> None:
    """A megabyte packs a gigabyte of zeros."""
    path = understated(tmp_path / f"odd{'.zip' if name == METADATA else '.npz'}", name, bytes(100_000_000), says=1000)
    tracemalloc.start()
    try:
        refused(read, path, tmp_path / "logs", "Bad CRC-32")
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("method", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
@pytest.mark.parametrize(("ending", "read"), [(".zip", unpack_capsule), (".npz", import_into)])
def test_a_method_that_unpacks_everything_at_once_is_refused(
    tmp_path: Path, ending: str, read: Callable[..., object], method: int
) -> None:
    path = tmp_path / f"odd{ending}"
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr(METADATA, "{}")
    refused(read, path, tmp_path / "logs", rf"packed by method {method}, not by the usual one, deflate")


@pytest.mark.parametrize("ending", [".npz", ".parquet"])
def test_a_table_that_does_not_fit_into_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    path = export_run(simulate(load_preset("paper"), duration=0.1), tmp_path / f"large{ending}")
    table = tmp_path / "proc" / "meminfo"
    table.parent.mkdir()
    table.write_text("MemTotal:       100 kB\nMemAvailable:   10 kB\n")
    monkeypatch.setattr(machine, "ROOT", tmp_path)
    refused(import_into, path, tmp_path / "logs", r"it unpacks to .* kB, and 10.2 kB of memory are free")
    table.write_text("MemAvailable:   1000 kB\n")
    assert import_into(path, tmp_path / "logs").exists()


def test_lone_surrogates_are_replaced(exported: Path, tmp_path: Path) -> None:
    with np.load(exported) as file:
        metadata = json.loads(str(file["flexlab"]))
    odd = "odd \ud800 text"
    metadata |= {
        "preset": odd,
        "status": ["finished", odd, 0.1],
        "events": [{"time": 0.05, "text": odd, "level": "info", "command": None}],
    }
    path = change_metadata(exported, tmp_path / "odd.npz", json.dumps(metadata))
    found = read_recording(import_into(path, tmp_path / "logs"))
    assert found.status.text == "odd \N{REPLACEMENT CHARACTER} text"
    assert "odd \N{REPLACEMENT CHARACTER} text" in [event.text for event in found.events]


def test_a_column_with_a_very_long_name_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "odd.csv"
    path.write_text("# {}\n" + '"' + "a" * 300_000 + '",b\n1,2\n')
    refused(import_into, path, tmp_path / "logs", "is not a run exported by flexlab")


SMALL_DISKS = """
import os, resource, signal, sys
from pathlib import Path
from flexlab.presets import load_preset
from flexlab.sim.simulate import simulate
run = simulate(load_preset("paper"), duration=4.0)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
for disk in sys.argv[2:]:
    if os.fork():
        os.wait()
        continue
    from flexlab.errors import RecordingError
    from flexlab.recording.headless import HeadlessRecording
    from flexlab.recording.run_info import RunInfo
    room, *in_one_piece = disk.split()
    sys.dont_write_bytecode = True  # It would be cut off, too.
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(room), resource.RLIM_INFINITY))
    try:
        with HeadlessRecording(Path(sys.argv[1], disk), RunInfo("paper", run.scenario), None, bool(in_one_piece)) as recording:
            for first in range(0, len(run), 250):
                recording.write(run.slice(first, min(first + 250, len(run))))
    except RecordingError as error:
        print(disk, error, sep="|", flush=True)
    os._exit(0)
"""
DISKS = {"1000": False, "1000000": True, "1000000 in one piece": False}
"""Room on each small disk, bytes, and how the run is written → whether a part of the run is on it in the end."""


@pytest.fixture(scope="module")
def small_disks(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, str]]:
    """One run written to each of `DISKS`: the folder with a logs folder for each, and the error for each."""
    folder = tmp_path_factory.mktemp("small")
    said = start_script(SMALL_DISKS, folder, *DISKS).communicate()[0]
    return folder, dict(line.split("|", 1) for line in said.splitlines())


@pytest.mark.parametrize("disk", DISKS)
def test_a_full_disk_leaves_what_the_error_says(small_disks: tuple[Path, dict[str, str]], disk: str) -> None:
    logs, said = small_disks[0] / disk, small_disks[1][disk]
    if DISKS[disk]:
        (path,) = logs.glob("*.rrd")
        assert said.endswith(f"the run is recorded up to t = {read_recording(path).samples.time[-1]:g} s.")
    else:
        assert said.endswith("nothing of the run is recorded.")
        assert not list(logs.glob("*"))
