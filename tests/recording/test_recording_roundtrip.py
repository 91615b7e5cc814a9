"""What goes into a recording comes out of it again, and it holds what the viewer shows."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from recording_helpers import assert_same_bits, drawn_beam, plotted
from rerun.chunk import RrdReader

from flexlab.presets import load_preset, preset_names
from flexlab.recording.headless import HeadlessRecording, write_run
from flexlab.recording.reader import read_recording, read_scenario
from flexlab.recording.rerun_internals.tool import rerun_tool
from flexlab.recording.run_info import RunInfo
from flexlab.recording.store.run_files import run_state
from flexlab.sim.commands import ChangeScenario, Tap
from flexlab.sim.samples import Run, Status, join_blocks
from flexlab.sim.simulate import simulate
from flexlab.sim.snapshot import Event


@pytest.mark.parametrize("preset", preset_names())
def test_every_preset_comes_back_bit_for_bit(preset: str, tmp_path: Path) -> None:
    run = simulate(load_preset(preset), duration=0.3)
    found = read_recording(write_run(run, tmp_path, preset))
    assert_same_bits(found.samples, run)
    assert found.scenario == run.scenario
    assert (found.name, found.status, found.status.text) == (preset, run.status, run.status.text)
    assert found.state == "complete"


@pytest.mark.parametrize("period", [0.0005, 0.001, 0.007])
def test_other_sample_periods_come_back(period: float, tmp_path: Path) -> None:
    run = simulate(load_preset("paper"), duration=0.1, sample_period=period)
    found = read_recording(write_run(run, tmp_path, "paper"))
    assert_same_bits(found.samples, run)
    assert found.sample_period == pytest.approx(period, rel=1e-12)


def test_a_run_that_cannot_start_is_recorded_with_its_reason(tmp_path: Path) -> None:
    run = simulate(load_preset("paper").replace({"trajectory.center": (0.0, 5.0, 0.0)}), duration=0.1)
    assert run.status.failed
    found = read_recording(write_run(run, tmp_path, "far"))
    assert (found.status, found.status.text) == (run.status, run.status.text)
    assert_same_bits(found.samples, run)


def test_a_run_without_samples_is_a_recording_too(tmp_path: Path) -> None:
    with HeadlessRecording(tmp_path, RunInfo("empty", load_preset("paper"))) as recording:
        recording.end(Status("unreachable", "It could not start."))
    found = read_recording(recording.path)
    assert len(found.samples) == 0
    assert found.samples.joint_torque.shape == (0, 2, 3)
    assert found.status.text == "It could not start."


def test_events_keep_their_order_time_and_command(tmp_path: Path) -> None:
    events = [
        Event(0.1, "first of two at one instant", Tap(0.1, (0.3, 0.1))),
        Event(0.1, "second", ChangeScenario({"payload.bending_stiffness": 0.1 + 0.2})),
        Event(0.1 + 1e-12, "refused", level="error"),
    ]
    with HeadlessRecording(tmp_path, RunInfo("paper", load_preset("paper"))) as recording:
        for event in events:
            recording.note(event)
        recording.end(Status("finished"))
    assert list(read_recording(recording.path).events[:-1]) == events


def test_plots_show_the_samples_in_the_units_that_they_name(run: Run, recording_file: Path) -> None:
    scales = {
        "/error": 1e3 * run.tracking_error,
        "/vibration": 1e3 * np.stack([run.vibration, run.midspan_deflection, run.quasi_static_deflection], axis=1),
        "/internal_force": run.internal_force[:, 0],
        "/joint_torque": run.joint_torque.reshape(len(run), 6),
        "/sliding_variable": run.sliding_variable,
        "/bound_estimates": run.bound_estimates,
    }
    for entity, expected in scales.items():
        times, values = plotted(recording_file, entity)
        np.testing.assert_array_equal(times, np.arange(len(run)) * 1_000_000, err_msg=entity)
        np.testing.assert_array_equal(values, expected.astype(np.float32), err_msg=entity)
    _, energy = plotted(recording_file, "/energy")
    np.testing.assert_allclose(energy[:, 3], run.total_energy, rtol=1e-6)


def test_the_drawing_has_sixty_states_a_second(recording_file: Path) -> None:
    times, strips = drawn_beam(recording_file)
    assert len(times) == pytest.approx(61, abs=1)
    assert np.diff(np.unique(np.diff(times))).max() <= 1_000_000
    np.testing.assert_allclose(strips[0][[0, -1]], [[-0.25, 0.75, 0], [0.25, 0.75, 0]], atol=1e-7)


def test_the_file_contains_its_layout_and_its_parameters(recording_file: Path) -> None:
    reader = RrdReader(recording_file)
    assert len(reader.recordings()) == 1
    assert len(reader.blueprints()) == 1
    texts = [
        chunk.to_record_batch().column("TextDocument:text").to_pylist()[0][0]
        for chunk in reader.stream().filter(content=["/parameters"])
    ]
    assert "drawn **× 50**" in texts[0]
    assert '"bending_stiffness": 100.0' in texts[0]


def test_simulation_time_is_the_only_timeline(recording_file: Path) -> None:
    names = {name for chunk in RrdReader(recording_file).stream() for name in chunk.timeline_names}
    assert names == {"sim_time"}


def test_rerun_itself_finds_nothing_wrong(recording_file: Path) -> None:
    answer = subprocess.run(
        [rerun_tool(), "rrd", "verify", recording_file], capture_output=True, text=True, check=False
    )
    assert answer.returncode == 0, answer.stderr


LATE = """
import atexit, sys, threading
import flexlab
run = flexlab.simulate("paper", 0.01)
def late():
    threading.main_thread().join()
    run.save(sys.argv[1])
threading.Thread(target=late).start()
atexit.register(run.save, sys.argv[1])
"""


def test_a_script_that_ends_can_still_save_a_run(tmp_path: Path) -> None:
    """In a thread that outlives the script, or at its exit."""
    answer = subprocess.run([sys.executable, "-c", LATE, tmp_path], capture_output=True, text=True, check=True)
    assert answer.stderr == ""
    assert len(list(tmp_path.glob("*.rrd"))) == 2


def test_blocks_are_read_in_the_order_of_time_however_they_stand_in_the_file(run: Run, tmp_path: Path) -> None:
    with HeadlessRecording(tmp_path, RunInfo("paper", run.scenario)) as recording:
        for first in (300, 0, 100, 800, 200, 900, 400):
            recording.write(run.slice(first, first + 100))
    blocks = list(read_recording(recording.path).blocks())
    assert [round(block.time[0], 3) for block in blocks] == [0.0, 0.1, 0.2, 0.3, 0.4, 0.8, 0.9]
    assert_same_bits(join_blocks(blocks), read_recording(recording.path).samples)


def test_the_scenario_can_be_read_alone(run: Run, recording_file: Path) -> None:
    assert read_scenario(recording_file) == run.scenario
    assert read_recording(recording_file).name == "paper"
    assert run_state(recording_file) == "complete"
