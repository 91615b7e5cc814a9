"""Fixtures of the server's tests: real servers with real labs behind them."""

from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path

import few_pictures as seldom
import pytest
from person import TOKEN, open_server

from flexlab.presets import load_preset
from flexlab.recording.headless import HeadlessRecording
from flexlab.recording.run_info import RunInfo
from flexlab.server.front_server import FrontServer
from flexlab.server.labs import worker
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """Compile the engine before the first lab, so that no test waits for it."""
    World(load_preset("paper")).advance(2)


@pytest.fixture(scope="module")
def few_pictures(few_pictures: None) -> Iterator[None]:
    """Let private labs send few pictures as well."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(worker, "work", seldom.work)
        yield


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished recording of 0.5 s, dated to a day on which no server of the tests records."""
    run = simulate(load_preset("paper"), duration=0.5, sample_period=0.001)
    started = datetime(2025, 12, 31, 12, 0, 0).astimezone()
    with HeadlessRecording(
        tmp_path_factory.mktemp("recorded"), RunInfo("paper", run.scenario, started=started)
    ) as made:
        made.write_whole(run)
    return made.path


@pytest.fixture(scope="session")
def front_server(tmp_path_factory: pytest.TempPathFactory, recorded: Path) -> Iterator[FrontServer]:
    """A server on loopback with a shared lab, for all tests that do not change what other tests see."""
    logs = tmp_path_factory.mktemp("logs")
    for file in (recorded, recorded.with_suffix(".json")):
        (logs / file.name).write_bytes(file.read_bytes())
    with open_server(logs) as opened:
        yield opened


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FrontServer]:
    """A server that asks for a token."""
    with open_server(tmp_path_factory.mktemp("guarded"), token=TOKEN) as opened:
        yield opened


@pytest.fixture
def open_another(tmp_path: Path) -> Iterator[Callable[..., FrontServer]]:
    """A function that opens further servers; they are closed after the test."""
    servers: list[FrontServer] = []

    def opened(**settings) -> FrontServer:
        servers.append(open_server(tmp_path / "logs", **settings))
        return servers[-1]

    yield opened
    for front_server in servers:
        front_server.close()


@pytest.fixture
def logs(front_server: FrontServer) -> Path:
    """The logs folder of the shared server."""
    return front_server.settings.logs
