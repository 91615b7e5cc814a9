"""Real runs and real files for the tests of the recordings."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from get_browser import find_browser
from playwright.sync_api import Browser, sync_playwright

from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate

SOFTWARE_RENDERING = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
]


@pytest.fixture(scope="session")
def run() -> Run:
    """One second of the paper's run: the start-up ring and after."""
    return simulate(load_preset("paper"), duration=1.0)


@pytest.fixture
def recording_file(run: Run, tmp_path: Path) -> Path:
    """That run as a file."""
    return write_run(run, tmp_path, "paper")


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """A headless Chromium. Without one the browser tests fail on CI and are skipped, loudly, elsewhere."""
    path = find_browser()
    if path is None:
        message = "no Chromium found: install one (python tests/get_browser.py) to run the browser tests"
        if os.environ.get("CI"):
            pytest.fail(message)
        pytest.skip(message)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=SOFTWARE_RENDERING)
        yield browser
        browser.close()
