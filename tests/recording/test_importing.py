"""Exported runs and recordings made elsewhere can be imported into the library: with the same bits, and they replay."""

import io
import json
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest
from recording_helpers import assert_same_bits

from flexlab.analysis.replay import replay
from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.export import FORMATS, export_recording
from flexlab.recording.headless import HeadlessRecording
from flexlab.recording.importing import import_into
from flexlab.recording.reader import Recording, read_recording
from flexlab.recording.run_info import RunInfo
from flexlab.recording.store.notes import read_notes
from flexlab.recording.store.run_files import list_runs
from flexlab.recording.store.run_index import read_row
from flexlab.recording.table_columns import checked_blocks
from flexlab.sim.commands import ChangeScenario, Tap
from flexlab.sim.samples import Run, Samples, Status, WorldState
from flexlab.sim.snapshot import Event
from flexlab.sim.world import World
from flexlab.text import visible


@pytest.fixture
def original(tmp_path: Path) -> Recording:
    """A run that begins at t = 0.1 s, with a tap, a changed slider and a refused command."""
    world = World(load_preset("paper"))
    world.advance(100)
    with HeadlessRecording(tmp_path / "original", RunInfo("my run", world.scenario, start=world.state())) as recording:
        recording.write(world.observe())
        for command in (Tap(0.1, (0.01, 0.02)), ChangeScenario({"payload.bending_stiffness": 61.0})):
            recording.write(world.advance(80))
            world.apply(command)
            recording.note(Event(world.time, "changed", command))
        recording.note(Event(world.time, "refused", ChangeScenario({"gravity": 1e9}), level="error"))
        recording.write(world.advance(90))
        recording.end(Status("finished", "Done.", world.time))
    return read_recording(recording.path)


def test_a_table_that_begins_with_a_byte_order_mark_is_imported(original: Recording, tmp_path: Path) -> None:
    path = export_recording(original, tmp_path / "run.csv")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert_same_bits(read_recording(import_into(path, tmp_path / "logs")).samples, original.samples)


def assert_same_run(found: Recording, original: Recording) -> None:
    assert_same_bits(found.samples, original.samples)
    assert (found.name, found.scenario, found.started) == (original.name, original.scenario, original.started)
    assert (found.events, found.status, found.sample_period) == (
        original.events,
        original.status,
        original.sample_period,
    )
    assert found.start is not None
    for field in fields(WorldState):
        one, other = getattr(found.start, field.name), getattr(original.start, field.name)
        assert np.asarray(one).tobytes() == np.asarray(other).tobytes()
    assert replay(found).identical


@pytest.mark.parametrize("suffix", FORMATS)
def test_an_exported_run_comes_back_bit_for_bit_and_replays(suffix: str, original: Recording, tmp_path: Path) -> None:
    exported = export_recording(original, tmp_path / f"x{suffix}")
    found = read_recording(import_into(exported, tmp_path / "logs"))
    assert found.path.name == original.path.name
    assert_same_run(found, original)
    assert read_notes(found.path)["imported"] == exported.name
    assert read_notes(found.path)["duration"] == pytest.approx(0.25)


def test_an_import_keeps_the_versions_and_machine_that_made_the_run(original: Recording, tmp_path: Path) -> None:
    elsewhere = {"flexlab_version": "0.0.1", "numpy_version": "1.0", "machine": "Abacus"}
    exported = export_recording(replace(original, properties=original.properties | elsewhere), tmp_path / "x.npz")
    found = read_recording(import_into(exported, tmp_path / "logs"))
    assert found.properties == original.properties | elsewhere


def test_an_exported_part_of_a_run_comes_back_and_replays(original: Recording, tmp_path: Path) -> None:
    exported = export_recording(original, tmp_path / "x.parquet", start=0.2)
    found = read_recording(import_into(exported, tmp_path / "logs"))
    names = [field.name for field in fields(Samples)]
    assert_same_bits(found.samples, Samples(**{name: getattr(original.samples, name)[100:] for name in names}))
    assert replay(found).compared == 151


def test_a_recording_is_imported_as_an_identical_copy_beside_its_original(original: Recording, tmp_path: Path) -> None:
    logs = original.path.parent
    path = import_into(original.path, logs)
    assert path.name == original.path.stem + "-2.rrd"
    assert path.read_bytes() == original.path.read_bytes()
    assert_same_run(read_recording(path), original)
    notes = read_notes(path)
    assert (notes["rows"], notes["begins"], notes["duration"]) == (251, pytest.approx(0.1), pytest.approx(0.25))


def objects() -> bytes:
    """A NumPy archive that holds Python objects."""
    archive = io.BytesIO()
    np.savez(archive, a=np.array([{}], dtype=object))
    return archive.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("x.rrd", b"garbage", "is not a rerun recording"),
        ("x.rrd", b"RRF2garbage", "is damaged beyond repair"),
        ("x.csv", b"a,b\n1,2\n", r"is not a run exported by flexlab \(its first line has no metadata\)"),
        ("x.csv", b"", r"\(its first line has no metadata\)"),
        ("x.csv", b"# {}\n", r"\(it has no columns\)"),
        ("x.csv", b"# {}\na\n1\n", r"\(its metadata are missing or not complete\)"),
        ("x.csv", b"# {}\na,b,c,d\n1,2\n3,4\n", r"\(its rows have 2 values, and its head 4\)"),
        ("x.csv", b"# {}\na,b\n1,2\n3\n", r"\(the number of columns changed from 2 to 1 at row 2\)"),
        ("x.csv", b'"# {}";\na;b\n1;2\n', "a spreadsheet has saved it in a form of its own: import the file that was"),
        ("x.csv", b"# {}\na;b\n1,0;2,0\n", "a spreadsheet has saved it in a form of its own: import the file that was"),
        ("x.csv", "# {}\na,b\n1,2\n".encode("utf-16"), r"\(it is not text in UTF-8\)"),
        ("x.csv", b"# {nothing\na\n1\n", r"\(its metadata are not JSON\)"),
        ("x.csv", b"# " + b'{"a":' * 100_000 + b"\na\n1\n", r"\(its metadata are nested too deeply\)"),
        ("x.npz", objects(), r"\(it holds Python objects\)"),
        ("x.npz", b"PK", "is not a run exported by flexlab"),
        ("x.xlsx", b"PK", "choose a file that ends in .rrd, .csv, .parquet, .npz"),
    ],
)
def test_other_files_are_refused_and_leave_nothing(name: str, content: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=says):
        import_into(tmp_path / name, tmp_path / "logs")
    assert list_runs(tmp_path / "logs") == []


def changed_table(original: Recording, folder: Path, **metadata: object) -> Path:
    """An exported run whose metadata were changed by hand."""
    path = export_recording(original, folder / "x.csv")
    about, rest = path.read_text().split("\n", 1)
    values = json.loads(about.removeprefix("# ")) | metadata
    path.write_text(f"# {json.dumps(values)}\n{rest}")
    return path


@pytest.mark.parametrize(
    ("row", "time", "says"),
    [
        (0, "-inf", "row 1: time = -inf s is not finite"),
        (7, "nan", "row 8: time = nan s is not finite"),
        (7, "1e12", r"row 8: time = 1e\+12 s is beyond"),
        (7, "0.1060000001", "row 8: time = 0.1060000001 s is not later than the 0.106 s of the row before by 1 ns"),
        (7, "0.003", "row 8: time = 0.003 s is not later than the 0.106 s of the row before"),
    ],
)
def test_times_that_are_not_finite_and_increasing_are_refused_with_their_row(
    original: Recording, tmp_path: Path, row: int, time: str, says: str
) -> None:
    path = changed_table(original, tmp_path)
    lines = path.read_text().splitlines(keepends=True)
    lines[2 + row] = f"{time},{lines[2 + row].partition(',')[2]}"
    path.write_text("".join(lines))
    with pytest.raises(RecordingError, match=says):
        import_into(path, tmp_path / "logs")
    assert list_runs(tmp_path / "logs") == []


def test_rows_are_counted_over_all_blocks_of_a_file(original: Recording) -> None:
    samples = original.samples
    blocks = [samples.slice(0, 3), samples.slice(3, 3), samples.slice(3, 5), samples.slice(4, 8)]
    with pytest.raises(RecordingError, match=r"^x, row 6: time = 0\.104 s is not later than the 0\.104 s of the row"):
        list(checked_blocks("x", blocks))


@pytest.mark.parametrize(
    ("metadata", "says"),
    [
        ({"sample_period_s": 1e-300}, r"the sample period 1e-300 s is not usable: it must be 10⁻⁶ to 1 s"),
        ({"sample_period_s": -1}, "the sample period -1.0 s is not usable"),
        ({"sample_period_s": float("inf")}, "the sample period inf s is not usable"),
        ({"events": [{"time": float("nan"), "text": "", "level": "info", "command": None}]}, "event 1: time = nan s"),
        (
            {"events": [{"time": 1.0, "text": "", "level": "loud", "command": None}]},
            "event 1: level 'loud' is not one of",
        ),
        ({"events": [5]}, "exported by flexlab"),
        ({"events": 5}, "exported by flexlab"),
        ({"status": ["finished", "", float("inf")]}, "is not finite"),
        ({"status": 5}, "is not a run exported"),
        ({"scenario": 5}, "is not a run exported"),
        ({"format": 99}, "computed in format 99, and there are 1 to"),
        ({"started": "never"}, "was not exported by this version"),
        ({"start": {"tick": "x"}}, "was not exported by this version"),
        ({"start": 1}, "its metadata have another form"),
        ({"started": 1.5}, "its metadata have another form"),
        ({"events": False}, "its metadata have another form"),
        ({"status": 3}, "its metadata have another form"),
        *(({"computed_in": number}, "computed in format") for number in (-5, 0, 99, 10**30, 1.5, True, "x", None)),
    ],
)
def test_impossible_metadata_are_refused(original: Recording, tmp_path: Path, metadata: dict, says: str) -> None:
    with pytest.raises(RecordingError, match=says):
        import_into(changed_table(original, tmp_path, **metadata), tmp_path / "logs")
    assert list_runs(tmp_path / "logs") == []


def test_empty_texts_count_as_missing(original: Recording, tmp_path: Path) -> None:
    path = changed_table(original, tmp_path, preset="", processor="", status=["finished", "", 0.3])
    found = read_recording(import_into(path, tmp_path / "logs"))
    assert (found.name, found.properties["processor"]) == ("imported", "unknown")
    assert_same_bits(found.samples, original.samples)


def test_too_deeply_nested_metadata_are_refused(original: Recording, tmp_path: Path) -> None:
    path = changed_table(original, tmp_path)
    path.write_text("# " + "[" * 100_000 + "\n" + path.read_text().split("\n", 1)[1])
    with pytest.raises(RecordingError, match="is not a run exported"):
        import_into(path, tmp_path / "logs")


def test_a_recording_whose_times_go_back_is_refused(original: Recording, run: Run, tmp_path: Path) -> None:
    with HeadlessRecording(tmp_path / "made", RunInfo("paper", original.scenario)) as recording:
        for part in (run.slice(100, 200), run.slice(50, 150)):
            recording.write(part)
    with pytest.raises(RecordingError, match="is not later than the"):
        import_into(recording.path, tmp_path / "logs")
    assert list_runs(tmp_path / "logs") == []


@pytest.mark.parametrize("unit", ["mm", "cubits", "\x1b[2J"])
def test_a_column_with_an_unknown_unit_is_refused_not_left_out(unit: str, original: Recording, tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    export_recording(original, file)
    file.write_text(file.read_text(encoding="utf-8").replace("pose_x [m]", f"pose_x [{unit}]", 1), encoding="utf-8")
    with pytest.raises(RecordingError, match=r"has a unit that is not known for it: give pose_x \[m\]"):
        import_into(file, tmp_path / "other")
    assert not list(tmp_path.glob("other/*"))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda v: v + 1j, "complex numbers"),
        (lambda v: v.astype(str), "text"),
        (lambda v: v[1:], "values"),
        (np.atleast_2d, "values"),
    ],
)
def test_a_column_without_one_real_number_per_time_is_refused(
    change: Callable[[np.ndarray], np.ndarray], says: str, original: Recording, tmp_path: Path
) -> None:
    """Without a check, NumPy takes the real part of complex numbers."""
    file = tmp_path / "mine.npz"
    export_recording(original, file)
    with np.load(file) as columns:
        changed = dict(columns)
    changed["pose_x [m]"] = change(changed["pose_x [m]"])
    np.savez(file, **changed)
    with pytest.raises(
        RecordingError, match=rf"The column 'pose_x \[m\]' holds {says} .*: give \d+ real numbers, one per time"
    ):
        import_into(file, tmp_path / "other")
    assert not list(tmp_path.glob("other/*"))


@pytest.mark.parametrize(
    "change", [("pose_x [m]", "wind [m/s]"), ("pose_x [m]", "\x1b[2J"), ("input_work [J]", "input_works [J]")]
)
def test_a_column_with_an_unknown_name_is_left_out_and_named_in_the_note(
    change: tuple[str, str], original: Recording, tmp_path: Path
) -> None:
    file = tmp_path / "mine.csv"
    export_recording(original, file)
    file.write_text(file.read_text(encoding="utf-8").replace(*change, 1), encoding="utf-8")
    taken = import_into(file, tmp_path / "other")
    said = read_row(taken).note
    assert repr(visible(change[1])) in said
    assert ("'pose_y [m]'" in said) == change[0].startswith("pose"), (
        "a signal of which a part is missing is left out, too"
    )
    assert "torque" not in said
    export_recording(original, file)
    assert not read_row(import_into(file, tmp_path / "whole")).note


def test_missing_rows_are_counted_in_the_note(original: Recording, tmp_path: Path) -> None:
    file = export_recording(original, tmp_path / "cut.csv")
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in lines if not "0.1495" < line.partition(",")[0] < "0.1695"]
    file.write_text("".join(kept), encoding="utf-8")
    assert len(lines) - len(kept) == 20
    assert read_row(import_into(file, tmp_path / "once")).note == "Samples missing, between 0.149 s and 0.17 s: 20."
    file.write_text("".join(kept[:9] + kept[10:]), encoding="utf-8")
    said = read_row(import_into(file, tmp_path / "again")).note
    assert said == "Samples missing, in 2 places, first after 0.106 s: 21."


def twice_in_csv(file: Path) -> Path:
    file.write_text(file.read_text(encoding="utf-8").replace("pose_x [m]", "pose_y [m]", 1), encoding="utf-8")
    return file


def with_texts(original: Recording, folder: Path, name: str) -> tuple[Path, int]:
    """A table with one more column, a gigabyte of texts in 80 kB, as a page's dictionary holds each once; and their size."""
    honest = parquet.read_table(export_recording(original, folder / "honest.parquet"))
    rows, word = 51, "x" * 500_000
    schema = honest.schema.append(pa.field(name, pa.string())).with_metadata(honest.schema.metadata)
    with parquet.ParquetWriter(folder / "hostile.parquet", schema, compression="zstd") as writer:
        for first in range(0, len(honest), rows):
            piece = honest.slice(first, rows)
            writer.write_table(pa.table([*piece.columns, pa.array([word] * len(piece))], schema=schema))
    return folder / "hostile.parquet", len(word) * len(honest)


def test_a_column_of_texts_is_left_out_unread(original: Recording, tmp_path: Path) -> None:
    file, size = with_texts(original, tmp_path, "comment")
    pool = pa.default_memory_pool()
    before = pool.max_memory()
    path = import_into(file, tmp_path / "logs")
    assert pool.max_memory() - before < size / 2, "the texts were unpacked"
    assert_same_run(read_recording(path), original)
    assert "'comment'" in read_notes(path)["note"]


@pytest.mark.parametrize("name", ["pose_x [m]", "pose_x [m].note"])
def test_texts_under_the_name_of_a_signal_are_refused_unread(original: Recording, tmp_path: Path, name: str) -> None:
    """Arrow reads "a.b" with "a", as if it were a part of it."""
    file, size = with_texts(original, tmp_path, name)
    pool = pa.default_memory_pool()
    before = pool.max_memory()
    with pytest.raises(RecordingError, match="pose_x"):
        import_into(file, tmp_path / "logs")
    assert pool.max_memory() - before < size / 2, "the texts were unpacked"


def twice_in_parquet(file: Path) -> Path:
    table = parquet.read_table(file)
    names = ["pose_y [m]" if name == "pose_x [m]" else name for name in table.column_names]
    parquet.write_table(table.rename_columns(names), file)
    return file


def twice_in_metadata(file: Path) -> Path:
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("# {", '# {"pose_y [m]": 1, "pose_y [m]": 2, ', 1), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("twice", "name"),
    [(twice_in_csv, "x.csv"), (twice_in_parquet, "x.parquet"), (twice_in_metadata, "x.csv")],
)
def test_a_field_that_is_given_twice_is_refused(
    twice: Callable[[Path], Path], name: str, original: Recording, tmp_path: Path
) -> None:
    file = twice(export_recording(original, tmp_path / name))
    with pytest.raises(RecordingError, match=r"the field 'pose_y \[m\]' is given twice"):
        import_into(file, tmp_path / "logs")
    assert list_runs(tmp_path / "logs") == []


@pytest.mark.parametrize("kept", [("time",), ("time", "pose"), ("time", "joint_angle"), ("time", "beam_rates")])
def test_a_table_of_a_few_signals_becomes_a_run_without_the_others(
    kept: tuple[str, ...], original: Recording, tmp_path: Path
) -> None:
    path = export_recording(original, tmp_path / "few.csv")
    about, *lines = path.read_text(encoding="utf-8").splitlines()
    table = [line.split(",") for line in lines]
    places = [
        k for k, name in enumerate(table[0]) if any(name.startswith(f"{one} [") or f"{one}_" in name for one in kept)
    ]
    places = [k for k in places if "rate" not in table[0][k] or "beam_rates" in kept]
    rows = [",".join(row[k] for k in places) for row in table]
    path.write_text("\n".join([about, *rows]) + "\n", encoding="utf-8")
    found = read_recording(import_into(path, tmp_path / "logs")).samples
    for name in kept:
        np.testing.assert_array_equal(found[name], original.samples[name])
    assert np.isnan(found.joint_torque).all()
    assert found.joint_torque.shape == original.samples.joint_torque.shape
    assert found.beam_coordinates.shape == original.samples.beam_coordinates.shape


def test_a_table_without_times_is_refused(original: Recording, tmp_path: Path) -> None:
    path = export_recording(original, tmp_path / "few.csv")
    path.write_text(path.read_text(encoding="utf-8").replace("time [s]", "clock [s]", 1), encoding="utf-8")
    with pytest.raises(RecordingError, match=r"There is no column time \[s\]: give every row its time\."):
        import_into(path, tmp_path / "logs")
    assert list_runs(tmp_path / "logs") == []
