"""Real runs and real files for the tests of the recordings."""

from pathlib import Path

import pytest

from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate


@pytest.fixture(scope="session")
def run() -> Run:
    """One second of the paper's run: the ringing at the start and what follows."""
    return simulate(load_preset("paper"), duration=1.0)


@pytest.fixture
def recording_file(run: Run, tmp_path: Path) -> Path:
    """A recording of `run`."""
    return write_run(run, tmp_path, "paper")
