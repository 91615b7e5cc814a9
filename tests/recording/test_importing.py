"""What was exported, or recorded elsewhere, becomes a run of the library again: the same bits, and it still replays."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
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
from flexlab.recording.store.run_files import list_runs, read_notes
from flexlab.sim.commands import ChangeScenario, Tap
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import Event
from flexlab.sim.world import World
from flexlab.sim.world_state import WorldState


@pytest.fixture
def original(tmp_path: Path) -> Recording:
    """A run that went on at t = 0.1 s, was tapped and changed, and refused one command."""
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


def test_what_recorded_a_run_first_is_remembered(original: Recording, tmp_path: Path) -> None:
    elsewhere = {"flexlab_version": "0.0.1", "numpy_version": "1.0", "machine": "Abacus"}
    exported = export_recording(replace(original, properties=original.properties | elsewhere), tmp_path / "x.npz")
    found = read_recording(import_into(exported, tmp_path / "logs"))
    assert found.properties == original.properties | elsewhere


def test_a_part_of_a_run_comes_back_and_replays(original: Recording, tmp_path: Path) -> None:
    exported = export_recording(original, tmp_path / "x.parquet", start=0.2)
    found = read_recording(import_into(exported, tmp_path / "logs"))
    names = [field.name for field in fields(Samples)]
    assert_same_bits(found.samples, Samples(**{name: getattr(original.samples, name)[100:] for name in names}))
    assert replay(found).compared == 151


def test_a_recording_comes_in_as_it_is_beside_its_original(original: Recording, tmp_path: Path) -> None:
    logs = original.path.parent
    path = import_into(original.path, logs)
    assert path.name == original.path.stem + "-2.rrd"
    assert path.read_bytes() == original.path.read_bytes()
    assert_same_run(read_recording(path), original)
    assert read_notes(path)["rows"] == 251


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("x.rrd", b"garbage", "is not a rerun recording"),
        ("x.rrd", b"RRF2garbage", "is damaged beyond repair"),
        ("x.csv", b"a,b\n1,2\n", "is not a run exported by flexlab"),
        ("x.npz", b"PK", "is not a run exported by flexlab"),
        ("x.xlsx", b"PK", "let its name end in .rrd, .csv, .parquet, .npz"),
    ],
)
def test_anything_else_is_refused_and_leaves_nothing(name: str, content: bytes, says: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=says):
        import_into(tmp_path / name, tmp_path / "logs")
    assert list_runs(tmp_path / "logs") == []
