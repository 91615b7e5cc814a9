"""The recorder at work on a real runner: one file per run, every sample, every event."""

import threading
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_helpers import assert_same_bits, drawn_beam, wait_until

from flexlab.analysis.run_summary import MetricNotes
from flexlab.presets import load_preset
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.repair import unfinished_runs
from flexlab.recording.store.notes import read_notes
from flexlab.recording.store.run_files import list_runs, run_state
from flexlab.recording.store.run_index import read_row
from flexlab.sim.commands import ChangeScenario, LoadScenario, Pause, Pull, Reset, SetSpeed, Tap
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Status
from flexlab.sim.world import World


class Clock:
    """A clock that only a test moves, so that the test decides when a runner's frames come."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def drive(runner: Runner, clock: Clock, seconds: float) -> None:
    """Let `seconds` pass in frames of 1/50 s."""
    for _ in range(round(seconds * 50)):
        clock.now += 0.02
        runner.frame()


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_a_session_leaves_one_complete_file_per_run(tmp_path: Path, clock: Clock) -> None:
    recorder = Recorder(tmp_path)
    runner = Runner(load_preset("paper"), "paper", [recorder], clock=clock)
    drive(runner, clock, 0.5)
    runner.submit(Reset())
    drive(runner, clock, 0.2)
    runner.submit(LoadScenario(load_preset("soft-beam"), "soft beam/2"))
    drive(runner, clock, 0.3)
    runner.stop()
    recorder.close(finishing_time=60)
    runs = sorted((read_recording(path) for path in list_runs(tmp_path)), key=lambda run: (len(run.samples), run.name))
    assert [(run.name, run.state, run.status) for run in runs] == [
        ("paper", "complete", "finished"),
        ("soft beam/2", "complete", "finished"),
        ("paper", "complete", "finished"),
    ]
    assert not any(path.suffix not in (".rrd", ".json") for path in tmp_path.iterdir())
    assert any("soft-beam-2" in path.name for path in list_runs(tmp_path))
    for run in runs:
        np.testing.assert_array_equal(run.samples.time, np.arange(len(run.samples)) * 0.001)


def test_a_run_whose_metrics_fail_is_whole_and_the_next_one_is_recorded(tmp_path: Path, clock: Clock) -> None:
    class Failing(MetricNotes):
        def result(self, status: Status) -> dict[str, Any]:
            raise ZeroDivisionError("division by zero")

    made, told = [Failing, MetricNotes], list[str]()
    recorder = Recorder(
        tmp_path, on_problem=told.append, start_notes=lambda name, scenario: made.pop(0)(name, scenario)
    )
    runner = Runner(load_preset("paper"), "first", [recorder], clock=clock)
    drive(runner, clock, 0.2)
    runner.submit(LoadScenario(load_preset("paper"), "second"))
    drive(runner, clock, 0.3)
    runner.stop()
    recorder.close(finishing_time=60)
    runs = {run.name: run for run in map(read_recording, list_runs(tmp_path))}
    assert {name: run.status for name, run in runs.items()} == {"first": "finished", "second": "finished"}
    assert len(runs["first"].samples) == 201
    assert len(runs["second"].samples) > 200
    assert told == ["The recorder failed (ZeroDivisionError: division by zero)."]
    assert [read_notes(runs[name].path).get("metrics") is None for name in ("first", "second")] == [True, False]


def test_every_sample_is_recorded_and_a_world_reproduces_it(tmp_path: Path, clock: Clock) -> None:
    recorder = Recorder(tmp_path)
    runner = Runner(load_preset("paper"), "paper", [recorder], clock=clock)
    commands = [
        ChangeScenario({"payload.bending_stiffness": 37.0}),
        Tap(0.05, (0.1, 0.4)),
        Pull(0.1, (0.3, 0.9), 400.0),
        ChangeScenario({"trajectory.frequency": (0.7, 0.7, 0.7), "controller.feedback_gain": 300.0}),
        SetSpeed(2.0),
    ]
    for command in commands:
        drive(runner, clock, 0.1)
        runner.submit(command)
    drive(runner, clock, 0.1)
    runner.stop()
    recorder.close()
    (path,) = list_runs(tmp_path)
    found = read_recording(path)
    assert [event.command for event in found.events if event.command is not None] == commands
    assert found.start is not None
    world = World(found.scenario)
    world.restore(found.start)
    rows = [world.observe()]
    for event in found.events:
        ticks = round(event.time / 0.001) - world.tick
        if ticks > 0:
            rows.append(world.advance(ticks))
        if isinstance(event.command, (ChangeScenario, Tap, Pull)):
            world.apply(event.command)
    first = 0
    for block in rows:
        assert_same_bits(found.samples.slice(first, first + len(block)), block)
        first += len(block)
    assert first == len(found.samples)


def test_a_run_continues_in_a_new_file_after_a_change_of_structure(tmp_path: Path, clock: Clock) -> None:
    recorder = Recorder(tmp_path)
    runner = Runner(load_preset("paper"), "paper", [recorder], clock=clock)
    drive(runner, clock, 0.2)
    runner.submit(ChangeScenario({"payload.element_count": 4}))
    drive(runner, clock, 0.2)
    runner.stop()
    recorder.close()
    two, four = sorted((read_recording(path) for path in list_runs(tmp_path)), key=lambda run: run.samples.time[0])
    assert two.samples.beam_coordinates.shape[1] == 4
    assert four.samples.beam_coordinates.shape[1] == 8
    assert four.samples.time[0] == two.samples.time[-1]
    assert four.start is not None
    assert four.start.tick == round(four.samples.time[0] / 0.001)


def test_a_full_queue_drops_and_counts_samples_without_blocking(tmp_path: Path) -> None:
    world = World(load_preset("paper"))
    release = threading.Event()
    recorder = Recorder(tmp_path, on_problem=lambda text: None, queue_rows=500)
    recorder.begin_run(1, "paper", world.scenario, world.state())
    recorder._queue.put(lambda: release.wait(30) and None)  # A disk that does not answer.
    dropped = [recorder.take_samples(1, world.advance(100), 1.0) for _ in range(8)]
    release.set()
    assert dropped == [0, 0, 0, 0, 0, 100, 100, 100]
    assert recorder.dropped_rows == 300
    recorder.end_run(1, Status("finished"))
    recorder.close()
    (path,) = list_runs(tmp_path)
    assert len(read_recording(path).samples) == 500
    assert read_notes(path)["dropped"] == 300


def test_labs_that_start_in_the_same_folder_and_second_write_separate_files(tmp_path: Path) -> None:
    world = World(load_preset("paper"))
    recorders = [Recorder(tmp_path) for _ in range(3)]
    for recorder in recorders:
        recorder.begin_run(1, "paper", world.scenario, world.state())
    samples = world.advance(50)
    for recorder in recorders:
        recorder.take_samples(1, samples, 1.0)
    wait_until(lambda: all(recorder.path for recorder in recorders), "all have a file")
    paths = {recorder.path for recorder in recorders}
    assert len(paths) == 3
    assert {run_state(path) for path in paths if path} == {"in use"}
    assert {read_row(path).preset for path in paths if path} == {"paper"}
    for recorder in recorders:
        recorder.close(finishing_time=60)
    for path in paths:
        assert path is not None
        assert_same_bits(read_recording(path).samples, samples)
        assert run_state(path) == "complete"


def test_a_file_is_claimed_even_if_others_read_it_while_it_is_made(tmp_path: Path) -> None:
    looking, world = threading.Event(), World(load_preset("paper"))
    looking.set()

    def look() -> None:
        while looking.is_set():
            for path in [*list_runs(tmp_path), *unfinished_runs(tmp_path)]:
                run_state(path)

    observers = [threading.Thread(target=look) for _ in range(2)]
    for observer in observers:
        observer.start()
    told: list[str] = []
    recorder = Recorder(tmp_path, on_problem=told.append)
    for number in range(20):
        recorder.begin_run(number, "paper", world.scenario, world.state())
        recorder.end_run(number, Status("finished"))
    recorder.close(finishing_time=60)
    looking.clear()
    for observer in observers:
        observer.join()
    assert told == []
    assert len(list_runs(tmp_path)) == 20


def test_the_next_recorder_mends_the_file_of_a_killed_lab(tmp_path: Path, recording_file: Path) -> None:
    whole = recording_file.read_bytes()
    recording_file.write_bytes(whole[: len(whole) * 3 // 4])
    recording_file.with_suffix(".json").unlink()
    assert run_state(recording_file) == "unfinished"
    recorder = Recorder(recording_file.parent)
    wait_until(lambda: run_state(recording_file) == "recovered", "the file is mended")
    recorder.close()


def test_a_file_name_holds_the_start_time_and_the_preset(tmp_path: Path) -> None:
    world = World(load_preset("paper"))
    recorder = Recorder(tmp_path)
    recorder.begin_run(1, "paper", world.scenario, world.state())
    wait_until(lambda: recorder.path, "there is a file")
    recorder.close()
    (path,) = list_runs(tmp_path)
    stamp, name = path.stem[:19], path.stem[20:]
    assert abs((datetime.now() - datetime.strptime(stamp, "%Y-%m-%dT%H-%M-%S")).total_seconds()) < 60
    assert name == "paper"


def test_slow_motion_is_drawn_at_every_sample(tmp_path: Path, clock: Clock) -> None:
    recorder = Recorder(tmp_path)
    runner = Runner(load_preset("paper"), "paper", [recorder], clock=clock)
    runner.submit(SetSpeed(1 / 256))
    drive(runner, clock, 10)
    runner.submit(Pause())
    drive(runner, clock, 0.1)
    runner.stop()
    recorder.close()
    (path,) = list_runs(tmp_path)
    np.testing.assert_array_equal(drawn_beam(path)[0], np.rint(1e9 * read_recording(path).samples.time))
