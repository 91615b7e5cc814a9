"""Recordings with bytes changed by a disk or a transfer: read as they were or refused, never read as another run."""

import os
import random
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from exported import export_run
from pyarrow import parquet

from flexlab.errors import RecordingError
from flexlab.recording import repair
from flexlab.recording.course import Course
from flexlab.recording.headless import write_run
from flexlab.recording.importing import import_into
from flexlab.recording.reader import Recording, read_recording, read_scenario
from flexlab.recording.store.notes import notes_path
from flexlab.recording.store.run_files import list_runs
from flexlab.recording.viewer import review
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Run
from flexlab.sim.snapshot import Event
from flexlab.sim.world import World

FLIPS = 25
"""Number of bits flipped near each word, one at a time."""
GOLDEN = Path(__file__).parent / "golden"


@pytest.fixture
def sound(run: Run, tmp_path: Path) -> Path:
    change = Event(0.01, "Softer", ChangeScenario({"payload.bending_stiffness": 61.0}))
    short = Run(**run.slice(0, 40).signals(), scenario=run.scenario, status=run.status)
    return write_run(short, tmp_path, "sound", course=Course(0.001, (change,), World(run.scenario).state()))


def said(recording: Recording) -> tuple[object, ...]:
    """Everything from which results are computed."""
    numbers = {name: np.asarray(signal).tobytes() for name, signal in recording.samples.signals().items()}
    circumstances = recording.scenario, repr(recording.events), repr(recording.start), str(recording.status)
    return numbers, *circumstances, recording.status, recording.sample_period, recording.started, recording.part


def flipped(path: Path, word: bytes, around: int) -> Iterator[Path]:
    """Copies with one flipped bit each, less than `around` bytes after the start of a word."""
    whole = path.read_bytes()
    places = [place for place in range(len(whole)) if whole.startswith(word, place)]
    assert places
    choice = random.Random(len(word))
    for _ in range(FLIPS):
        place = choice.choice(places) + choice.randrange(around)
        data = bytearray(whole)
        data[place] ^= 1 << choice.randrange(8)
        copy = path.with_name(f"flipped-{place}.rrd")
        copy.write_bytes(data)
        yield copy
        copy.unlink()


@pytest.mark.parametrize(
    ("word", "around", "some_are_harmless"),
    [
        (b'"linear_density":2.0', 25, False),
        (b"exact/events", 12, True),
        (b"exact/samples", 13, True),
        (b"exact/start", 11, True),
        (b"held_torque", 300, True),
        (b"Softer", 200, True),
    ],
)
def test_a_recording_with_a_flipped_bit_is_never_read_as_another_run(
    sound: Path, word: bytes, around: int, some_are_harmless: bool
) -> None:
    before, read = said(read_recording(sound)), 0
    for copy in flipped(sound, word, around):
        try:
            found = said(read_recording(copy))
        except RecordingError:
            continue
        assert found == before, copy.name
        read += 1
    assert (read > 0) == some_are_harmless


@pytest.mark.parametrize(("number", "place"), [(1, 112264), (1, 113764)])
def test_lost_events_and_samples_of_older_recordings_are_noticed(number: int, place: int, tmp_path: Path) -> None:
    """Each of these bytes makes rerun silently leave out all events or all samples."""
    data = bytearray((GOLDEN / f"format-{number}" / "continued.rrd").read_bytes())
    data[place] ^= 128
    copy = tmp_path / "flipped.rrd"
    copy.write_bytes(data)
    with pytest.raises(RecordingError, match="damaged"):
        assert read_recording(copy).samples is None


@pytest.mark.parametrize(("place", "bits"), [(75634, 8), (79380, 8), (108561, 105)])
def test_a_recording_that_would_crash_its_reader_is_refused(place: int, bits: int, tmp_path: Path) -> None:
    """The last has a zero byte in a name."""
    data = bytearray((GOLDEN / "format-2" / "single-arm.rrd").read_bytes())
    data[place] ^= bits
    copy = tmp_path / "flipped.rrd"
    copy.write_bytes(data)
    logs = tmp_path / "logs"
    for read in (
        read_recording,
        read_scenario,
        lambda path: import_into(path, logs),
        lambda path: review(path).__enter__(),
    ):
        with pytest.raises(RecordingError, match="is damaged beyond repair: nothing of its run can be read"):
            read(copy)
    assert list_runs(logs) == []


def test_a_recording_of_one_s_own_that_was_damaged_later_is_refused(sound: Path) -> None:
    """What its notes said of the file before the damage kept it from being checked, and Python crashed."""
    assert len(read_recording(sound).samples) == 40
    before = sound.stat()
    data = bytearray((GOLDEN / "format-2" / "single-arm.rrd").read_bytes())
    data[75634] ^= 8
    sound.write_bytes(data)
    os.utime(sound, ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(RecordingError, match="is damaged beyond repair: nothing of its run can be read"):
        read_recording(sound)


def test_a_recording_is_checked_for_damage_only_once(sound: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A check takes 10 ms per MB."""
    copy = sound.with_name("copy.rrd")
    shutil.copy(sound, copy)
    shutil.copy(notes_path(sound), notes_path(copy))
    read_recording(copy)
    monkeypatch.setattr(repair, "crashes_readers", lambda path: True)
    for path in (sound, copy):
        assert len(read_recording(path).samples) == 40


def test_a_parquet_table_with_a_flipped_bit_is_refused(run: Run, tmp_path: Path) -> None:
    """The other tables have checksums anyway, or are text that people may edit. Its bits were imported as another run."""
    table = export_run(
        Run(**run.slice(0, 40).signals(), scenario=run.scenario, status=run.status), tmp_path / "a.parquet"
    )
    group = parquet.ParquetFile(table).metadata.row_group(0)
    for column in map(group.column, range(0, group.num_columns, 10)):
        data = bytearray(table.read_bytes())
        data[column.data_page_offset + column.total_compressed_size - 1] ^= 1
        copy = tmp_path / "flipped.parquet"
        copy.write_bytes(data)
        with pytest.raises(RecordingError, match="could not verify page integrity"):
            import_into(copy, tmp_path / "logs")
