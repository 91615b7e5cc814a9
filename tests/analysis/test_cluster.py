"""Studies on a real Dask cluster: killing a worker or the scheduler during a study changes no byte of the result."""

import contextlib
import gc
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pyarrow as pa
import pytest
from distributed import Client
from own_law_text import PD, forget_own_laws

import flexlab
from flexlab.analysis.leaderboard.board import make_tasks, run_board
from flexlab.analysis.leaderboard.case import chosen_cases
from flexlab.analysis.leaderboard.entry import chosen_entrants
from flexlab.analysis.leaderboard.store import RowStore
from flexlab.analysis.sweep.axes import parse_axes
from flexlab.analysis.sweep.result import part_file
from flexlab.analysis.tuning import parse_cost, tune
from flexlab.analysis.workers import chosen_workers
from flexlab.errors import StudyError
from flexlab.own.files import law_kind

VARY = ["payload.bending_stiffness=1:1000:log:16", "controller.feedback_gain=50:500:4"]


def start(folder: Path, *words: str) -> subprocess.Popen:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli." + words[0], *words[1:]], cwd=folder, env=environment,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def address_of(scheduler: subprocess.Popen) -> str:
    assert scheduler.stderr is not None
    for line in scheduler.stderr:
        if found := re.search(r"Scheduler at:\s+(tcp://\S+)", line):
            # Go on reading, so that the process's output never fills the pipe.
            threading.Thread(target=scheduler.stderr.read, daemon=True).start()
            return found[1]
    raise AssertionError("the scheduler said no address")


@contextlib.contextmanager
def running_scheduler(folder: Path) -> Iterator[subprocess.Popen]:
    process = start(folder, "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A scheduler that keeps running."""
    with running_scheduler(tmp_path_factory.mktemp("scheduler")) as process:
        yield address_of(process)


@pytest.fixture(scope="module")
def computed_here(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The table of the sweep, computed without a cluster."""
    folder = tmp_path_factory.mktemp("here")
    flexlab.sweep("paper", VARY, 0.3, folder=folder)
    return (folder / "cells.parquet").read_bytes()


def start_worker(folder: Path, address: str) -> subprocess.Popen:
    words = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1", "--local-directory", str(folder))
    process = start(folder, "dask_worker", address, *words)
    assert process.stderr is not None
    threading.Thread(target=process.stderr.read, daemon=True).start()
    return process


Workers = Callable[[int], list[subprocess.Popen]]


@pytest.fixture(scope="module")
def workers(scheduler: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workers]:
    """Return a function that gives the scheduler this many workers: those that earlier tests left, and new ones."""
    folder, running = tmp_path_factory.mktemp("workers"), list[subprocess.Popen]()

    def end(those: list[subprocess.Popen]) -> None:
        for worker in those:
            worker.kill()
            worker.wait()

    def exactly(count: int) -> list[subprocess.Popen]:
        end(running[count:])
        running[:] = [worker for worker in running if worker.poll() is None]
        running.extend(start_worker(folder, scheduler) for _ in range(count - len(running)))
        deadline = time.monotonic() + 60
        with Client(scheduler, set_as_default=False) as client:
            while len(client.scheduler_info()["workers"]) != count:
                assert time.monotonic() < deadline
                time.sleep(0.05)
        return running

    yield exactly
    end(running)


def test_a_killed_worker_changes_no_byte_of_a_sweep(
    scheduler: str, workers: Workers, computed_here: bytes, tmp_path: Path
):
    first, _ = workers(2)
    cells = tmp_path / "cluster"
    computed = threading.Thread(
        target=flexlab.sweep, args=("paper", VARY, 0.3), kwargs={"folder": cells, "cluster": scheduler}
    )
    computed.start()
    deadline = time.monotonic() + 120
    while len(list((cells / "parts").glob("0*.parquet"))) < 5:
        assert time.monotonic() < deadline
        assert computed.is_alive()
        time.sleep(0.005)
    first.kill()
    assert not (cells / "cells.parquet").exists(), "killed on the way"
    computed.join(120)
    assert (cells / "cells.parquet").read_bytes() == computed_here


def test_a_killed_worker_changes_no_byte_of_a_tuning_and_a_leaderboard(
    scheduler: str, workers: Workers, tmp_path: Path
):
    scenario = flexlab.load_preset("paper")
    axes = parse_axes(["controller.feedback_gain=50:500:log"], scenario)
    cases = [replace(case, duration=0.1, commands=()) for case in chosen_cases(["B1", "B2", "B5"], long=False)]
    tasks = make_tasks(cases, chosen_entrants(["adaptive-sliding-mode", "pd"]))
    cost, here, there = parse_cost("rms_error.y"), chosen_workers(2), chosen_workers(cluster=scheduler)
    workers(3)
    with Client(scheduler, set_as_default=False) as client:
        working = dict(client.run(os.getpid))

        def kill_one_until(left: int, done: int, total: int) -> None:
            """Kill a busy worker once the study is under way."""
            busy = [address for address, keys in client.processing().items() if keys and address in working]
            if len(working) > left and 2 <= done < total and busy:
                os.kill(working.pop(busy[0]), signal.SIGKILL)

        tunings = [
            tune(scenario, axes, cost, duration=0.1, candidates=16, told=told, workers=chosen)
            for chosen, told in ((there, partial(kill_one_until, 2)), (here, lambda done, total: None))
        ]
        assert len(working) == 2
        assert len(tunings[0].candidates) > 10
        assert as_bytes(tunings[0].table) == as_bytes(tunings[1].table)
        folders = tmp_path / "there", tmp_path / "here"
        run_board(tasks, RowStore(folders[0]), there, partial(kill_one_until, 1))
        assert len(working) == 1
    run_board(tasks, RowStore(folders[1]), here)
    rows = [{file.name: file.read_bytes() for file in folder.rglob("*.json")} for folder in folders]
    assert len(rows[0]) > 10
    assert rows[0] == rows[1]


def as_bytes(table: pa.Table) -> bytes:
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, table.schema) as stream:
        stream.write_table(table)
    return sink.getvalue().to_pybytes()


def test_every_study_takes_a_users_own_law_to_the_workers(scheduler: str, workers: Workers, tmp_path: Path):
    (tmp_path / "own_pd.py").write_text(PD, encoding="utf-8")
    workers(1)
    try:
        vary = {"controller.kind": [law_kind(tmp_path / "own_pd.py"), "pd"], "payload.bending_stiffness": [10.0, 100.0]}
        there = flexlab.sweep("paper", vary, 0.05, folder=tmp_path / "cluster", cluster=scheduler)
        assert there.table.column("status").to_pylist() == ["finished"] * 4
        here = flexlab.sweep("paper", vary, 0.05, folder=tmp_path / "here")
        assert here.table.equals(there.table)
        check_many(scheduler, tmp_path / "own_pd.py")
        check_leaderboard(scheduler, tmp_path / "own_pd.py", tmp_path)
        check_tuning(scheduler, tmp_path / "own_pd.py")
    finally:
        forget_own_laws()


def check_many(scheduler: str, law: Path) -> None:
    scenarios = ["paper", "soft-beam", {"gravity": 99.0}]
    here, there = (
        flexlab.simulate_many(scenarios, 0.05, law=law, progress=False, cluster=cluster)
        for cluster in (None, scheduler)
    )
    assert [(str(run.status), run.name) for run in there] == [
        ("finished", "paper"),
        ("finished", "soft-beam"),
        ("invalid", "run"),
    ]
    assert [run.result_hash for run in here[:2]] == [run.result_hash for run in there[:2]]
    assert there[2].status.text == here[2].status.text


def check_leaderboard(scheduler: str, law: Path, folder: Path) -> None:
    cases = [replace(case, duration=0.05, commands=()) for case in chosen_cases(["B1", "B5"], long=False)]
    here, there = (
        flexlab.leaderboard(
            ["pd", law], cases, folder=folder / f"board-{cluster is None}", progress=False, cluster=cluster
        )
        for cluster in (None, scheduler)
    )
    assert there.computed == len(there.rows) >= 4
    assert not there.failed
    assert there.table.equals(here.table)


def check_tuning(scheduler: str, law: Path) -> None:
    scenario = flexlab.load_preset("paper").replace({"controller.kind": law_kind(law)})
    axes = parse_axes(["payload.bending_stiffness=50:200"], scenario)
    here, there = (
        tune(scenario, axes, parse_cost("rms-y"), duration=0.05, candidates=10, workers=chosen_workers(cluster=cluster))
        for cluster in (None, scheduler)
    )
    assert [(one.changes, one.cost) for one in here.candidates] == [(one.changes, one.cost) for one in there.candidates]
    assert there.best.metrics is not None


@pytest.fixture
def scheduler_to_kill(tmp_path: Path) -> Iterator[subprocess.Popen]:
    with running_scheduler(tmp_path) as process:
        yield process


def test_a_killed_scheduler_is_reported_and_the_sweep_can_be_completed_later(
    scheduler_to_kill: subprocess.Popen, computed_here: bytes, tmp_path: Path, computed_parts: list[str]
):
    address, told = address_of(scheduler_to_kill), list[str]()
    worker = start_worker(tmp_path, address)

    def compute() -> None:
        try:
            flexlab.sweep("paper", VARY, 0.3, folder=tmp_path / "cells", cluster=address)
        except StudyError as error:
            told.append(str(error))

    try:
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=60)
        computed = threading.Thread(target=compute)
        computed.start()
        deadline = time.monotonic() + 120
        while len(list((tmp_path / "cells" / "parts").glob("0*.parquet"))) < 5:
            assert time.monotonic() < deadline
            assert computed.is_alive()
            time.sleep(0.005)
        scheduler_to_kill.kill()
        computed.join(120)
        assert told
        assert told[0].startswith("The cluster failed (")
        assert "\n" not in told[0]
        kept = {file.name for file in (tmp_path / "cells" / "parts").glob("0*.parquet")}
        assert 5 <= len(kept) < 64
        computed_parts.clear()
        sweep = flexlab.sweep("paper", VARY, 0.3, folder=tmp_path / "cells")
        assert set(computed_parts) == {part_file(sweep.folder, cells).name for cells in sweep.plan.parts()} - kept
        assert (tmp_path / "cells" / "cells.parquet").read_bytes() == computed_here
    finally:
        worker.kill()
        worker.wait()


def test_a_web_server_is_not_taken_for_a_scheduler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Read as a length, the first bytes of its answer ask for more memory than there is."""
    monkeypatch.setattr("flexlab.analysis.workers.PATIENCE", 1.0)
    with socket.create_server(("127.0.0.1", 0)) as plug:

        def answer() -> None:
            with contextlib.suppress(OSError):
                while True:
                    visitor, _ = plug.accept()
                    with visitor:
                        visitor.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")
                        visitor.recv(1)

        threading.Thread(target=answer, daemon=True).start()
        address = f"tcp://127.0.0.1:{plug.getsockname()[1]}"
        with pytest.raises(StudyError, match="No Dask scheduler answers"):
            flexlab.sweep("paper", VARY, 0.1, folder=tmp_path / "c", cluster=address)


def test_a_cluster_that_cannot_be_used_is_refused(
    scheduler: str, workers: Workers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    workers(0)
    with pytest.raises(StudyError, match="has no workers: start some with dask worker tcp://"):
        flexlab.sweep("paper", VARY, 0.1, folder=tmp_path / "a", cluster=scheduler)
    monkeypatch.setattr("flexlab.analysis.workers.PATIENCE", 1.0)  # Only the addresses below are waited for.
    for address in ("tcp://127.0.0.1:1", "nowhere", "tcp://no.such.host.invalid:8786"):
        with pytest.raises(StudyError, match="No Dask scheduler answers") as caught:
            flexlab.sweep("paper", VARY, 0.1, folder=tmp_path / "b", cluster=address)
        assert "\n" not in str(caught.value)
        left = [one for one in gc.get_objects() if type(one) is Client and one.status != "closed"]
        assert not left, "they would close themselves while another one is made"
    with pytest.raises(StudyError, match="give one of the two"):
        flexlab.sweep("paper", VARY, 0.1, workers=2, cluster=scheduler)
