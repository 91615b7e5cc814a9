"""The live stream against rerun's own client: who joins late still sees parameters and what happened."""

import signal
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from recording_helpers import plotted, wait_until
from rerun.chunk import RrdReader

from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.live import LiveHub
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import Recorder
from flexlab.recording.rerun_internals.tool import rerun_tool
from flexlab.recording.store.run_files import list_runs
from flexlab.sim.commands import ChangeScenario, Reset
from flexlab.sim.runner import Runner
from flexlab.sim.world import World


@pytest.fixture
def hub() -> Iterator[LiveHub]:
    hub = LiveHub()
    yield hub
    hub.close()


class Client:
    """A real rerun program that connects to a hub and saves what it gets."""

    def __init__(self, url: str, path: Path):
        self.path = path
        nothing = subprocess.DEVNULL
        command = [rerun_tool(), "--save", str(path), url]
        self._process = subprocess.Popen(command, stdin=nothing, stdout=nothing, stderr=nothing)

    def received(self) -> int:
        return self.path.stat().st_size if self.path.exists() else 0

    def runs(self) -> int:
        try:
            return sum(entry.application_id == "flexlab" for entry in RrdReader(self.path).recordings())
        except (ValueError, RuntimeError, OSError):
            return 0  # Nothing there yet, or half a message.

    def close(self) -> None:
        self._process.send_signal(signal.SIGINT)
        self._process.wait(30)


def test_a_client_that_joins_after_ten_seconds_has_it_all(tmp_path: Path, hub: LiveHub) -> None:
    World(load_preset("paper")).advance(2)
    recorder = Recorder(tmp_path / "logs", hub)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    wait_until(lambda: runner.snapshot.latest.time[0] > 1.0, "some time has passed")
    runner.submit(ChangeScenario({"payload.bending_stiffness": 50.0}))
    wait_until(lambda: runner.snapshot.latest.time[0] > 10.0, "ten seconds have passed")
    client = Client(hub.url, tmp_path / "late.rrd")
    wait_until(lambda: client.received() > 1_000_000, "the client has received the past")
    joined = float(runner.snapshot.latest.time[0])
    wait_until(lambda: runner.snapshot.latest.time[0] > joined + 2, "two seconds are watched")
    snapshot = runner.snapshot
    client.close()
    runner.stop()
    recorder.close()
    assert snapshot.dropped_samples == 0
    assert not snapshot.too_slow
    (path,) = list_runs(tmp_path / "logs")
    exact = read_recording(path).samples
    expected = {
        "/error": 1e3 * exact.tracking_error,
        "/vibration": 1e3
        * np.stack([exact.vibration, exact.midspan_deflection, exact.quasi_static_deflection], axis=1),
        "/internal_force": exact.internal_force[:, 0],
    }
    for entity, values in expected.items():
        times, found = plotted(client.path, entity)
        assert times[0] == 0
        assert times[-1] / 1e9 > joined
        np.testing.assert_array_equal(np.diff(times), 1_000_000)
        np.testing.assert_array_equal(found, values[: len(found)].astype(np.float32))
    entities = {chunk.entity_path for chunk in RrdReader(client.path).stream()}
    assert {"/parameters", "/events", "/scene/beam", "/scene/links", "/real_time_factor"} <= entities
    assert RrdReader(client.path).blueprints()


def test_all_runs_go_through_one_hub(tmp_path: Path, hub: LiveHub) -> None:
    recorder = Recorder(tmp_path / "logs", hub)
    runner = Runner(load_preset("paper"), "paper", [recorder])
    runner.start()
    for _ in range(3):
        runner.submit(Reset())
        reset = runner.snapshot.run_number
        wait_until(lambda reset=reset: runner.snapshot.run_number > reset, "a new run has begun")
        wait_until(lambda: runner.snapshot.latest.time[0] > 0.3, "it is under way")
    runner.stop()
    recorder.close()
    client = Client(hub.url, tmp_path / "late.rrd")
    wait_until(lambda: client.runs() == 4, "the client has received all runs")
    client.close()


def test_a_recording_does_not_depend_on_viewers(tmp_path: Path) -> None:
    hub = LiveHub()
    recorder = Recorder(tmp_path, hub)
    world = World(load_preset("paper"))
    recorder.begin_run(1, "paper", world.scenario, world.state())
    recorder.take_samples(1, world.advance(100), 1.0)
    wait_until(lambda: recorder.path, "there is a file")
    recorder.close()
    hub.close()
    (path,) = list_runs(tmp_path)
    assert len(read_recording(path).samples) == 100


def test_a_busy_port_is_said(hub: LiveHub) -> None:
    with pytest.raises(RecordingError, match=rf"cannot listen on 127\.0\.0\.1:{hub.port}: the port is in use"):
        LiveHub(port=hub.port)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(RecordingError, match="the port is in use"):
            LiveHub(port=port)


@pytest.mark.parametrize(
    ("host", "port", "sentence"),
    [
        ("127.0.0.1", 70000, "port = 70000 is not a port"),
        ("127.0.0.1", -1, "port = -1 is not a port"),
        ("198.51.100.7", 0, "host = 198.51.100.7 is not an address of this machine"),
    ],
)
def test_what_is_no_address_is_said(host: str, port: int, sentence: str) -> None:
    with pytest.raises(RecordingError, match=sentence):
        LiveHub(host, port)


def test_hubs_take_free_ports_and_give_them_back() -> None:
    one, two = LiveHub(), LiveHub()
    assert one.port != two.port
    port = one.port
    one.close()
    one.close()
    open_when_free(port).close()
    two.close()


def open_when_free(port: int) -> LiveHub:
    """A hub on a port that was just given back; rerun's server closes its socket on a thread of its own."""
    deadline = time.monotonic() + 20
    while True:
        try:
            return LiveHub(port=port)
        except RecordingError:
            assert time.monotonic() < deadline, "the port was never given back"
            time.sleep(0.1)


def test_the_hub_listens_on_this_machine_only(hub: LiveHub) -> None:
    assert hub.url == f"rerun+http://127.0.0.1:{hub.port}/proxy"
    with socket.socket() as probe:
        probe.settimeout(5)
        probe.connect(("127.0.0.1", hub.port))
    with socket.socket() as probe:
        probe.settimeout(5)
        with pytest.raises(OSError, match="refused"):
            probe.connect(("127.0.0.2", hub.port))
