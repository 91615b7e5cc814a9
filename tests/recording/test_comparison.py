"""Runs compared: their curves in one file, their different settings and their metrics."""

import re
from pathlib import Path

import numpy as np
import pytest
from recording_helpers import plotted
from rerun.chunk import RrdReader

import flexlab
from flexlab.analysis.comparison import compare, compare_into
from flexlab.analysis.metrics import run_metrics
from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.headless import HeadlessRecording, write_run
from flexlab.recording.reader import read_recording
from flexlab.recording.run_info import RunInfo
from flexlab.sim.commands import Pull, Tap
from flexlab.sim.samples import Run, Status
from flexlab.sim.simulate import simulate
from flexlab.sim.snapshot import Event
from flexlab.sim.world import World
from flexlab.text import number_text
from flexlab.views import fitting_exaggeration


@pytest.fixture
def softer(tmp_path: Path) -> Path:
    scenario = load_preset("paper").replace({"payload.bending_stiffness": 60.0, "payload.damping.kind": "modal"})
    return write_run(simulate(scenario, duration=0.5), tmp_path, "softer")


def test_curves_of_all_runs_are_in_one_file(recording_file: Path, softer: Path, run: Run, tmp_path: Path) -> None:
    target = tmp_path / "both.out"
    compare_into([recording_file, softer], target)
    _, first = plotted(target, "/runs/A/error")
    times, second = plotted(target, "/runs/B/error")
    np.testing.assert_array_equal(first, (1e3 * run.tracking_error).astype(np.float32))
    assert len(second) == 501
    assert times[-1] == 500_000_000
    reader = RrdReader(target)
    assert reader.blueprints()
    names = {chunk.entity_path for chunk in reader.stream()}
    assert {"/runs/A/scene/beam", "/runs/B/scene/links", "/differences"} <= names


def test_every_view_has_one_place_in_the_layout(recording_file: Path, softer: Path, tmp_path: Path) -> None:
    """Rerun drops a layout in which a view has two places."""
    target = tmp_path / "both.out"
    compare_into([recording_file, softer], target)
    reader = RrdReader(target)
    (layout,) = reader.blueprints()
    batches = [chunk.to_record_batch() for chunk in reader.stream(store=layout) if "/container/" in chunk.entity_path]
    placed = [
        part for batch in batches for row in batch.column("ContainerBlueprint:contents").to_pylist() for part in row
    ]
    assert len(placed) > 10
    assert len(placed) == len(set(placed))
    named, views = "ViewBlueprint:display_name", (chunk.to_record_batch() for chunk in reader.stream(store=layout))
    names = {row[0] for view in views if named in view.schema.names for row in view.column(named).to_pylist()}
    factors = [fitting_exaggeration(read_recording(path).scenario) for path in (recording_file, softer)]
    assert factors[0] > factors[1]
    drawn = f"deflection drawn × {number_text(factors[1])}"
    assert {f"A: paper, {drawn}", f"B: softer, {drawn}"} <= names, "one factor, at which no run bends too much"


def test_tables_say_what_differs(recording_file: Path, softer: Path) -> None:
    found = compare([recording_file, softer])
    assert ("payload.bending_stiffness", ("100", "60")) in found.settings
    assert ("payload.damping.kind", ("nodal", "modal")) in found.settings
    text = found.text()
    assert found.duration == (1.0, 0.5)
    assert "## Metrics of the first 0.5 s of each run" in text
    assert "| Duration (s) | 0.5 | 0.5 | 0 |" in text
    assert "| `payload.bending_stiffness` | 100 | 60 |" in text
    assert "Residual vibration" not in text, "no run of this path stops"


def test_runs_of_different_length_are_compared_over_what_both_have(
    recording_file: Path, softer: Path, run: Run
) -> None:
    """The whole second of the longer run is not compared with half a second of the shorter one."""
    expected = run_metrics(run, (0.0, 0.5))
    found = {rows[0].column.field: rows[0].value for rows in compare([recording_file, softer]).metrics}
    wanted = {row.column.field: row.value for row in expected.rows}
    assert found == pytest.approx(wanted, rel=0, abs=0, nan_ok=True)
    assert found["rms-x"] > 1.2 * 1e3 * run_metrics(run).rms_error[0]
    compared = compare([recording_file, softer])
    assert compared.table["rms_error.x"][0].as_py() == pytest.approx(expected.rms_error[0], rel=1e-12), "SI"
    assert compared.plot("rms-x").axes[0].patches[0].get_height() == pytest.approx(found["rms-x"], rel=1e-12), "mm"


def test_a_run_that_stopped_early_leaves_the_others_their_metrics(
    recording_file: Path, softer: Path, tmp_path: Path
) -> None:
    """Of a class's runs, one that stopped at once reduced those of all others to their first sample."""
    far = load_preset("paper").replace({"trajectory.amplitude": (0.9, 0.9, 0.0)})
    stopped = write_run(simulate(far, 1.0), tmp_path, "far")
    without, found = compare([recording_file, softer]), compare([recording_file, softer, stopped])
    assert found.window == without.window > 0.4
    assert [[row.text for row in rows[:2]] for rows in found.metrics] == [
        [row.text for row in rows] for rows in without.metrics
    ]
    assert {rows[2].text for rows in found.metrics if rows[2].key != "Duration [s]"} == {"did not finish"}
    assert compare([stopped, stopped]).window == 0.0


def test_every_run_is_compared_with_the_first(recording_file: Path, softer: Path) -> None:
    found = compare([recording_file, recording_file, softer, softer])
    assert ("payload.bending_stiffness", ("100", "100", "60", "60")) in found.settings
    assert found.repeated() == [("B", "A"), ("D", "C")]


def test_different_commands_and_sample_periods_are_shown(tmp_path: Path) -> None:
    """Runs of one scenario may differ in these alone; they were once said not to differ."""
    tapped = flexlab.simulate("paper", 0.05, commands=[(0.02, Tap(0.0, (0.0, 0.1)))])
    pulled = flexlab.simulate("paper", 0.05, commands=[(0.001 * k, Pull(0.0, (0.0, 1.0), k)) for k in range(1, 6)])
    found = flexlab.compare(tapped, pulled, flexlab.simulate("paper", 0.05, 0.003))
    assert found.settings[0] == ("sample_period", ("0.001 s", "0.001 s", "0.003 s"))
    name, (tap, pulls, none) = found.settings[1]
    assert (name, none, tap) == ("commands", "–", "t = 0.02 s: Tap the beam at s = 0.000 m with (0, 0.1) N·s")
    assert re.search(r"; t = 0\.003 s: .* 3 N/m; 2 more$", pulls)
    assert found.table.column("sample_period").to_pylist() == ["0.001 s", "0.001 s", "0.003 s"]
    assert flexlab.compare(tapped, tapped).settings == ()
    bars = found.plot("settling_time", "peak_torque").axes
    assert [[text.get_text() for text in axes.texts] for axes in bars] == [["not settled"] * 3, []], (
        "and no bars of 0 s"
    )
    (told,) = found.coarse
    assert told.startswith("C: Samples are 3 ms apart, and the beam's first mode has a period of 22.4 ms")
    assert told in found.text()


def test_a_start_that_is_left_open_is_told_in_words(tmp_path: Path) -> None:
    """The only difference between `paper` and `smooth-start` read "– | 0, 0, 0"."""
    files = [flexlab.simulate(name, 0.01).save(tmp_path) for name in ("paper", "smooth-start")]
    assert compare(files).settings == (("initial.pose_rate", ("0, 0, 0", "that of the path")),)


def test_the_same_run_twice_differs_in_nothing(recording_file: Path) -> None:
    assert compare([recording_file, recording_file]).settings == ()
    assert "same scenario" in compare([recording_file, recording_file]).text()


def test_a_title_with_a_bar_and_a_line_break_stays_in_its_column(tmp_path: Path) -> None:
    odd = load_preset("paper").replace({"title": "stiff | soft\nbeams"})
    files = [flexlab.simulate(scenario, 0.01).save(tmp_path) for scenario in (odd, "paper")]
    assert r"| 0.01 | stiff \| soft beams |" in compare(files).text()


def test_time_is_counted_from_each_runs_first_sample(recording_file: Path, tmp_path: Path) -> None:
    world = World(load_preset("paper"))
    world.advance(250)
    world.apply(Tap(0.0, (0.0, 0.1)))
    with HeadlessRecording(tmp_path, RunInfo("late", world.scenario, start=world.state())) as late:
        late.write(world.observe())
        late.note(Event(0.25, "There is no arm 3.", Tap(0.0, (0.0, 0.1)), "error"))
        late.write(world.advance(100))
        late.end(Status("finished"))
    target = tmp_path / "both.out"
    compare_into([recording_file, late.path], target)
    times, _ = plotted(target, "/runs/B/vibration")
    assert (times[0], times[-1]) == (0, 100_000_000)
    assert compare([recording_file, late.path]).settings == (), "a refused command is none"


def test_what_cannot_be_compared_is_refused_with_a_reason(recording_file: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="Choose 2 to 6 runs to compare, not 1"):
        compare_into([recording_file], tmp_path / "x.out")
    with pytest.raises(RecordingError, match="There is no recording"):
        compare([recording_file, tmp_path / "no.rrd"])
    with pytest.raises(RecordingError, match="The comparison cannot be written"):
        compare_into([recording_file, recording_file], tmp_path / "no" / "x.out")
