"""Shared by all tests: where things are, the command line, and one browser."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from get_browser import find_browser
from lab_process import Lab
from playwright.sync_api import Browser, sync_playwright
from workers import is_of_browser, pytest_cmdline_main, pytest_xdist_make_scheduler

__all__ = ["pytest_cmdline_main", "pytest_xdist_make_scheduler"]

ROOT = Path(__file__).resolve().parent.parent

SOFTWARE_RENDERING = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--no-sandbox",
    "--ignore-gpu-blocklist",
]
"""What Chromium needs to draw the lab and rerun's viewer without a graphics card."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what drives a browser: `pytest -m "not browser"` is the quick answer."""
    for item in items:
        if "chromium" in getattr(item, "fixturenames", ()):
            if not is_of_browser(item.nodeid):
                raise pytest.UsageError(f"{item.nodeid} drives a browser: its file's name has to end in _in_browser.py")
            item.add_marker("browser")


@pytest.fixture(scope="session")
def root() -> Path:
    """The source checkout."""
    return ROOT


@pytest.fixture
def flexlab_command(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the command line as a person would, in an empty folder; returns exit code, output and complaints."""

    def run(*words: str, folder: Path = tmp_path) -> subprocess.CompletedProcess[str]:
        environment = os.environ | {"COLUMNS": "120", "NO_COLOR": "1", "PYTHONIOENCODING": "utf-8"}
        return subprocess.run(
            [sys.executable, "-m", "flexlab", *words],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=300,
            check=False,
        )

    return run


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    """A headless Chromium, one for all tests: playwright cannot be started twice on one thread."""
    path = find_browser()
    assert path, "no Chromium found: install one with python tests/get_browser.py"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=SOFTWARE_RENDERING)
        yield browser
        browser.close()


@pytest.fixture
def start_lab(tmp_path: Path) -> Iterator[Callable[..., Lab]]:
    """Starts the lab as a person would, in the test's folder; ends what is left after the test."""
    labs: list[Lab] = []

    def start(*words: str, **circumstances) -> Lab:
        labs.append(Lab(tmp_path, *words, **circumstances))
        return labs[-1]

    yield start
    for lab in labs:
        if lab.process.poll() is None:
            lab.process.kill()
        lab.wait_for_end()
