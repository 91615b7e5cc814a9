"""A killed lab loses 0.3 s at most: real processes, kill -9 at random instants."""

import os
import random
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from recording_helpers import plotted, start_script

from flexlab.analysis.replay import replay
from flexlab.recording.reader import read_recording
from flexlab.recording.recorder import SHOW_PERIOD
from flexlab.recording.repair import finish, finish_abandoned
from flexlab.recording.store.run_files import list_runs, run_state

LABS = """
import os, sys, time
from pathlib import Path
from flexlab.presets import load_preset
from flexlab.recording.recorder import Recorder
from flexlab.sim.commands import Reset, Tap
from flexlab.sim.runner import Runner
from flexlab.sim.world import World

World(load_preset("paper")).advance(2)
for folder in sys.stdin:
    if not os.fork():
        break
    os.wait()
    print("ended", flush=True)
else:
    sys.exit()
print(os.getpid(), flush=True)
recorder = Recorder(Path(folder.strip()))
runner = Runner(load_preset("paper"), "paper", [recorder])
while recorder.path is None:
    time.sleep(0.01)
runner.start()
runner.submit(Tap(0.0, (0.0, 0.1)))
while True:
    print(f"{runner.snapshot.latest.time[0]:.3f}", flush=True)
    time.sleep(0.005)
"""
"""Forks a headless lab for each folder that it is told. A lab prints its number, then how far its simulation is."""

ALLOWED_LOSS = 0.3
"""Largest loss that is allowed, s of simulation at real time."""


KILLS = int(os.environ.get("FLEXLAB_KILLS", "4"))
"""Number of instants that are tried: 100 take three minutes."""


@pytest.fixture(scope="module")
def labs() -> Iterator["subprocess.Popen[str]"]:
    with start_script(LABS) as forking:
        yield forking


@pytest.mark.parametrize("seed", range(KILLS))
def test_a_lab_killed_with_kill_minus_nine_loses_little(
    seed: int, labs: "subprocess.Popen[str]", tmp_path: Path
) -> None:
    assert labs.stdin is not None
    assert labs.stdout is not None
    print(tmp_path, file=labs.stdin, flush=True)
    lab, reached, end = int(labs.stdout.readline()), 0.0, 0.6 + random.Random(seed).random()
    try:
        while reached < end:
            reached = float(labs.stdout.readline())
        (path,) = list_runs(tmp_path)
        assert run_state(path) == "in use"
    finally:
        os.kill(lab, signal.SIGKILL)
    for said in iter(labs.stdout.readline, "ended\n"):
        reached = float(said)
    assert run_state(path) == "unfinished"
    found = read_recording(path)
    np.testing.assert_array_equal(found.samples.time, np.arange(len(found.samples)) * 0.001)
    assert reached - found.samples.time[-1] <= ALLOWED_LOSS
    assert any(event.command is not None for event in found.events)
    assert replay(found).identical
    finish(path)
    assert run_state(path) == "recovered"
    for entity in ("/error", "/vibration", "/internal_force"):
        assert reached - plotted(path, entity)[0][-1] / 1e9 <= ALLOWED_LOSS + SHOW_PERIOD


KILLED_WRITING = """
import os, sys
from pathlib import Path
from flexlab.files import replacing
with replacing(Path(sys.argv[1], "run.rrd")) as draft:
    draft.write_bytes(bytes(1000))
    os.kill(os.getpid(), 9)
"""


def test_the_draft_of_a_process_that_was_killed_as_it_wrote_is_removed_after_a_day(tmp_path: Path) -> None:
    """Such files are hidden: killed repairs of long recordings filled a disk unseen."""
    start_script(KILLED_WRITING, tmp_path).wait()
    (draft,) = tmp_path.iterdir()
    finish_abandoned(tmp_path)
    assert draft.exists(), "somebody may be writing it"
    os.utime(draft, (time.time() - 1.01 * 86400,) * 2)
    other = tmp_path / ".mine.draft"
    other.touch()
    os.utime(other, (0, 0))
    finish_abandoned(tmp_path)
    assert (draft.exists(), other.exists()) == (False, True)
