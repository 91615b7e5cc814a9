"""Real processes are killed and suspended: others go on, runs are kept, and nothing that is left behind hinders anybody."""

import contextlib
import json
import re
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Collection
from pathlib import Path

import psutil
import pytest
from http_client import upgrade, wait_until
from lab_process import Lab
from person import TOKEN, Visitor

from flexlab.errors import RecordingError
from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.recording.store.notes import read_notes
from flexlab.recording.store.run_files import is_in_use, list_runs, run_state
from flexlab.server.labs.per_visitor import LONGEST_ROUND, SILENCE
from flexlab.sim.simulate import simulate

StartLab = Callable[..., Lab]
SLOW_STEP, SLOW_TIME = 1e-5, 8.0
"""Step and duration of a run, s: its replay takes much longer than a process may take to end."""
SOON = 5.0
"""Time, s, in which a process that is told to end does so, even on a busy machine; the replay above takes longer."""
IDLE_CONNECTIONS = 400


def workers(lab: Lab) -> list[psutil.Process]:
    """The jobs and labs among a server's processes, without the process that they are forked from."""

    def works(process: psutil.Process) -> bool:
        try:
            words = " ".join(process.cmdline())
        except psutil.Error:  # It has just ended.
            return False
        return "spawn_main" in words or ("forkserver" in words and process.ppid() != lab.process.pid)

    return [process for process in psutil.Process(lab.process.pid).children(recursive=True) if works(process)]


def gone(process: psutil.Process) -> bool:
    """Whether a process has ended; without a parent that waits for it, it stays as a zombie."""
    try:
        return process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


def begun_run(lab: Lab, before: Collection[Path] = ()) -> Path | None:
    """The run that was not there before, once its file has samples; until then None."""
    for run in set(list_runs(lab.folder / "logs")) - set(before):
        with contextlib.suppress(RecordingError):
            return run if len(read_recording(run).samples) else None
    return None


def test_a_second_ctrl_c_ends_the_server_at_once(start_lab: StartLab):
    lab = start_lab("--private")
    Visitor(lab.url()).enter()
    (worker,) = workers(lab)
    wait_until(lambda: begun_run(lab), "it is recorded")
    worker.suspend()  # This lab hangs, and an orderly close waits for it.
    try:
        lab.process.send_signal(signal.SIGINT)
        with pytest.raises(subprocess.TimeoutExpired):
            lab.process.wait(0.5)
        lab.process.send_signal(signal.SIGINT)
        assert lab.process.wait(SOON) == 128 + signal.SIGINT
    finally:
        worker.resume()
    wait_until(lambda: gone(worker), "the lab ends without its server")
    (run,) = list_runs(lab.folder / "logs")
    assert run_state(run) in ("complete", "unfinished")
    assert len(read_recording(run).samples) > 0


def test_a_visitor_with_the_token_gets_in_beside_hundreds_of_idle_connections(start_lab: StartLab):
    lab = start_lab("--token", TOKEN, handles=256)
    port = lab.port()
    idle: list[socket.socket] = []
    try:
        for _ in range(IDLE_CONNECTIONS):
            plug = socket.socket()
            plug.settimeout(SOON)
            plug.connect(("127.0.0.1", port))
            idle.append(plug)
        member = Visitor(lab.url())
        assert member.ask(f"/lab/?token={TOKEN}").status == 303
        assert member.ask("/lab/").status == 200
        assert member.ask("/lab", **upgrade()).status == 101
    finally:
        for plug in idle:
            plug.close()
    assert lab.end() == 0
    assert len("".join(lab.complained)) < 100_000, "nor do they flood the log"


def test_a_server_that_was_suspended_for_a_while_closes_no_lab(start_lab: StartLab):
    lab = start_lab("--private")
    visitors = [Visitor(lab.url()) for _ in range(2)]
    labs = [visitor.enter() for visitor in visitors]
    processes = [psutil.Process(lab.process.pid), *workers(lab)]
    for process in processes:
        process.suspend()
    time.sleep(SILENCE + 1.0)
    for process in processes:
        process.resume()
    for visitor, path in zip(visitors, labs, strict=True):
        assert visitor.enter() == path
    time.sleep(2 * LONGEST_ROUND)
    for visitor, path in zip(visitors, labs, strict=True):
        assert json.loads(visitor.state(path)).get("open"), visitor.state(path)
    assert lab.end() == 0
    assert lab.complained == []


def test_processes_end_with_a_killed_server_and_the_next_start_removes_its_folder(start_lab: StartLab, tmp_path: Path):
    scenario = load_preset("paper").replace({"simulation.step": SLOW_STEP})
    slow = write_run(simulate(scenario, duration=SLOW_TIME, sample_period=0.001), tmp_path / "logs", "slow")
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    lab = start_lab("--private", TMPDIR=str(temporary))
    visitor, port = Visitor(lab.url()), lab.port()
    visitor.enter()
    run = wait_until(lambda: begun_run(lab, [slow]), "it is recorded")
    labs = workers(lab)
    assert visitor.ask(f"/runs/{slow.stem}/replay", method="POST").status == 303
    (job,) = wait_until(lambda: [each for each in workers(lab) if each not in labs], "the replay's process begins")
    said = wait_until(
        lambda: re.search(r"Replay: ([1-9]\d?) %", visitor.ask(f"/runs/{slow.stem}/replay").text), "it is under way"
    )
    processes = psutil.Process(lab.process.pid).children(recursive=True)
    assert {job, *labs} < set(processes)
    lab.process.kill()
    assert int(said[1]) < 50
    wait_until(lambda: gone(job), "the replay's process ends", patience=SOON)
    wait_until(lambda: all(map(gone, processes)), "its processes end by themselves")
    assert list(temporary.glob("flexlab-server-*")), "a killed server cannot clean up"
    assert set(list_runs(lab.folder / "logs")) == {run, slow}
    assert not is_in_use(run)
    assert read_notes(run)["ended"], "the lab closed its run itself"
    assert len(read_recording(run).samples) > 0
    again = start_lab("--private", port=port, TMPDIR=str(temporary))
    assert Visitor(again.url()).enter()
    assert len(list(temporary.glob("flexlab-server-*"))) == 1, "that of the killed one is gone"
    assert again.end() == 0
    assert list(temporary.glob("flexlab-server-*")) == []
