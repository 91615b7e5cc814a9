"""The live data as rerun's own reader finds them: a viewer that joins late still gets the parameters and the history."""

from pathlib import Path

import numpy as np
import pytest
from recording_helpers import opened, plotted, wait_until

from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.live import LiveHub
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.store.run_files import list_runs
from flexlab.sim.commands import ChangeScenario, Reset, SetSpeed
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Status
from flexlab.sim.world import World


def joined(hub: LiveHub, path: Path) -> Path:
    """What a viewer that joins now gets, as a file."""
    _, pieces = hub.after(-1)
    path.write_bytes(b"".join(pieces))
    return path


def runs(path: Path) -> list[str]:
    """Ids of flexlab's recordings in a file."""
    return [entry.recording_id for entry in opened(path).recordings() if entry.application_id == "flexlab"]


def test_a_late_viewer_gets_the_whole_history(tmp_path: Path) -> None:
    World(load_preset("paper")).advance(2)
    hub = LiveHub()
    recorder = Recorder(tmp_path / "logs", hub.take)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    runner.submit(SetSpeed(4.0))
    wait_until(lambda: runner.snapshot.latest.time[0] > 1.0, "some time has passed")
    runner.submit(ChangeScenario({"payload.bending_stiffness": 50.0}))
    wait_until(lambda: runner.snapshot.latest.time[0] > 10.0, "ten seconds have passed")
    number, past = hub.after(-1)
    then = float(runner.snapshot.latest.time[0])
    wait_until(lambda: runner.snapshot.latest.time[0] > then + 2, "two seconds are watched")
    runner.stop()
    recorder.close()
    _, present = hub.after(number)
    late = tmp_path / "late.rrd"
    late.write_bytes(b"".join(past + present))
    assert recorder.dropped_rows == 0
    (path,) = list_runs(tmp_path / "logs")
    exact = read_recording(path).samples
    vibration = np.stack([exact.vibration, exact.midspan_deflection, exact.quasi_static_deflection], axis=1)
    expected = {
        "/error": 1e3 * exact.tracking_error,
        "/vibration": 1e3 * vibration,
        "/internal_force": exact.internal_force[:, 0],
    }
    for entity, values in expected.items():
        times, found = plotted(late, entity)
        assert times[0] == 0
        assert times[-1] / 1e9 > then + 1
        np.testing.assert_array_equal(np.diff(times), 1_000_000)
        np.testing.assert_array_equal(found, values[: len(found)].astype(np.float32))
    entities = {chunk.entity_path for chunk in opened(late).stream()}
    assert {"/parameters", "/events", "/scene/beam", "/scene/links", "/real_time_factor"} <= entities
    assert "/exact/samples" not in entities, "viewers have no use for them"
    assert opened(late).blueprints()


def test_all_runs_go_through_one_hub(tmp_path: Path) -> None:
    hub = LiveHub()
    recorder = Recorder(tmp_path / "logs", hub.take)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    for _ in range(3):
        runner.submit(Reset())
        reset = runner.snapshot.run_number
        wait_until(lambda reset=reset: runner.snapshot.run_number > reset, "a new run has begun")
        wait_until(lambda: runner.snapshot.latest.time[0] > 0.3, "it is under way")
    runner.stop()
    recorder.close()
    assert len(set(runs(joined(hub, tmp_path / "late.rrd")))) == 4


def test_the_oldest_data_are_dropped_but_the_parameters_of_the_run_stay(tmp_path: Path) -> None:
    hub = LiveHub(most_bytes=1_500_000)
    recorder = Recorder(tmp_path / "logs", hub.take, queue_rows=10**6)
    world = World(load_preset("paper"))
    for number in range(2):
        recorder.begin_run(number, "paper", world.scenario, world.state())
        for _ in range(20):
            newest, _ = hub.after(0)
            recorder.take_samples(number, world.advance(1000), 1.0)
            wait_until(lambda newest=newest: hub.after(newest)[1], "the hub has it")
        recorder.end_run(number, Status("finished", ""))
    recorder.close()
    found = joined(hub, tmp_path / "late.rrd")
    assert found.stat().st_size < 1_600_000
    assert len(set(runs(found))) == 1, "a run of which nothing is left is gone as a whole"
    assert {"/parameters", "/scene/beam"} <= {chunk.entity_path for chunk in opened(found).stream()}
    times, _ = plotted(found, "/error")
    assert times[-1] / 1e9 == pytest.approx(world.time, abs=0.01)


def test_a_recording_does_not_depend_on_viewers(tmp_path: Path) -> None:
    hub = LiveHub()
    told: list[str] = []
    recorder = Recorder(tmp_path, hub.take, told.append)
    world = World(load_preset("paper"))
    recorder.begin_run(1, "paper", world.scenario, world.state())
    recorder.take_samples(1, world.advance(100), 1.0)
    wait_until(lambda: recorder.path, "there is a file")
    hub.close()
    hub.close()
    recorder.take_samples(1, world.advance(100), 1.0)
    recorder.close()
    assert told == ["The live stream is closed."]
    (path,) = list_runs(tmp_path)
    assert len(read_recording(path).samples) == 200


def test_a_closed_hub_is_empty_and_refuses_data(tmp_path: Path) -> None:
    hub = LiveHub()
    hub.take("run", b"RRF2")
    assert hub.after(-1)[0] == 0
    hub.close()
    assert (hub.is_closed, hub.after(-1)) == (True, (-1, []))
    with pytest.raises(RecordingError, match="The live stream is closed"):
        hub.take("run", b"RRF2")
