"""Recordings of every format ever written can be read, listed, exported, imported, compared, replayed and continued."""

import hashlib
import json
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from flexlab.analysis.comparison import compare_into
from flexlab.analysis.replay import TOLERANCE, replay
from flexlab.analysis.resume import Repetition, resume
from flexlab.analysis.run_summary import note_metrics
from flexlab.recording.export import export_recording, import_run
from flexlab.recording.importing import import_into
from flexlab.recording.reader import read_range, read_recording, read_scenario
from flexlab.recording.run_info import these_versions
from flexlab.recording.store.formats import ARITHMETIC, FORMAT, STEPS, same_numbers
from flexlab.recording.store.run_files import list_runs, run_state
from flexlab.sim.samples import join_blocks
from flexlab.sim.signals import TABLE
from flexlab.sim.world import World
from flexlab.text import number_text

AGREEMENT = 1e-4
"""Largest difference between the formats' engines, as a share of the peak: older ones integrated some damping less exactly."""

SAME_POSE = 1e-11
"""Largest difference of a pose between machines, m and rad: half a second of rounding errors."""

FOLDER = Path(__file__).parent / "golden"
CASES = [
    (int(folder.name[7:]), path) for folder in sorted(FOLDER.glob("format-*")) for path in sorted(folder.glob("*.rrd"))
]
every_recording = pytest.mark.parametrize(("number", "path"), CASES, ids=[f"{n}-{path.stem}" for n, path in CASES])


golden, replayed = cache(read_recording), cache(lambda path: replay(golden(path)))
"""A golden recording, and what its replay found, once for all tests."""


def facts(path: Path) -> dict:
    return json.loads((path.parent / "facts.json").read_text(encoding="utf-8"))[path.stem]


def digest(signal: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(signal).tobytes()).hexdigest()


def test_there_is_a_golden_recording_of_every_format() -> None:
    assert {number for number, _ in CASES} == set(range(1, FORMAT + 1))
    assert STEPS.keys() == set(range(1, FORMAT))


@every_recording
def test_it_is_read_with_every_bit_that_was_written(number: int, path: Path) -> None:
    known, recording = facts(path), read_recording(path)
    assert recording.format == number
    assert len(recording.samples) == known["samples"]
    assert (str(recording.status), [event.text for event in recording.events]) == (known["status"], known["events"])
    assert recording.samples.absent == TABLE.keys() - known["sha256"].keys(), "signals that came later, in any format"
    same = {name for name, signal in TABLE.items() if signal.since <= number}
    found = {name: digest(recording.samples[name]) for name in known["sha256"] if name in same or name not in TABLE}
    assert found == {name: value for name, value in known["sha256"].items() if name in found}
    assert len(found) >= len(known["sha256"]) - len(TABLE.keys() - same)


@every_recording
def test_its_blocks_and_ranges_hold_the_samples_of_the_whole(number: int, path: Path) -> None:
    whole = golden(path).samples
    in_blocks = join_blocks(list(golden(path).blocks()))
    middle = float(whole.time[len(whole) // 2])
    piece = read_range(path, middle, middle + 0.05)
    for name, signal in whole.signals().items():
        np.testing.assert_array_equal(in_blocks[name], signal)
        np.testing.assert_array_equal(piece[name], signal[len(whole) // 2 :][: len(piece)])


@every_recording
def test_it_replays_and_says_what_wrote_it(number: int, path: Path) -> None:
    """Every bit is the same if the arithmetic is. If not identical, it says what recorded it."""
    recording, found = golden(path), replayed(path)
    maker = f"recorded by flexlab {recording.properties['flexlab_version']}"
    if found.agrees and number < FORMAT:
        assert f"{maker} in format {number}" in found.text
        assert all(name in found.text for name in TABLE.keys() - same_numbers(number))
    if recording.properties.get("arithmetic") == ARITHMETIC:
        assert found.identical, found.text
    assert found.difference is None, found.text
    if not found.identical:
        assert f"{maker} (format {number})" in found.text
        assert f"a tolerance of {number_text(TOLERANCE)}" in found.text


@every_recording
def test_every_signal_means_what_it_means_today(number: int, path: Path) -> None:
    """A repetition, which computes today's signals, agrees even where a format recorded another quasi-static part."""
    recording = golden(path)
    again = join_blocks(list(Repetition(recording).samples_until(float(recording.samples.time[-1]))))
    for name in TABLE.keys() & facts(path)["sha256"].keys():
        largest = np.abs(again[name]).max()
        np.testing.assert_allclose(recording.samples[name], again[name], atol=AGREEMENT * largest, rtol=0, err_msg=name)


@every_recording
def test_it_is_listed_and_summarised(number: int, path: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copy(path, tmp_path))
    assert list_runs(tmp_path) == [copy]
    assert run_state(copy) in ("complete", "recovered")
    assert read_scenario(copy) == read_recording(copy).scenario
    assert note_metrics(copy)["metrics"]["Peak vibration [mm]"] > 0


@every_recording
def test_it_can_be_exported_and_imported_again(number: int, path: Path, tmp_path: Path) -> None:
    recording = golden(path)
    table = export_recording(recording, tmp_path / "run.parquet")
    back, about = import_run(table)
    assert about["format"] == FORMAT
    for name in TABLE:
        assert digest(back[name]) == digest(recording.samples[name]), name
    logs = tmp_path / "logs"
    logs.mkdir()
    again = read_recording(import_into(table, logs))
    assert again.format == FORMAT
    for name in TABLE:
        assert digest(again.samples[name]) == digest(recording.samples[name]), name
    for name in these_versions():
        assert again.properties[name] == recording.properties.get(name, "unknown"), name
    assert replay(again).agrees == replayed(path).agrees


@every_recording
def test_it_can_be_compared_with_another_one(number: int, path: Path, tmp_path: Path) -> None:
    other = next(other for _, other in CASES if other != path)
    compared = compare_into([path, other], tmp_path / "both.rrd")
    values = {row.title: row.value for rows in compared.metrics for row in rows}
    # A sine path never stops, so it has no residual vibration after a stop; no golden recording has the compression.
    known = ("Residual", "Peak compression")
    unknown = [name for name, value in values.items() if not np.isfinite(value) and not name.startswith(known)]
    assert len(unknown) <= 1, "only a run that has not settled has no settling time"


@every_recording
def test_a_lab_can_continue_it(number: int, path: Path) -> None:
    recording = read_recording(path)
    scenario, origin = resume(recording)
    world = World(scenario)
    world.restore(origin.state)
    samples = world.run(50)
    assert not world.status.failed
    # On other processors, BLAS and the C library round differently.
    np.testing.assert_allclose(samples.pose[0], recording.samples.pose[-1], rtol=0, atol=SAME_POSE)
    assert np.abs(samples.tracking_error).max() < 2 * np.abs(recording.samples.tracking_error).max()
