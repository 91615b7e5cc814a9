"""Real labs and a real headless Chromium for the tests of the lab."""

import os
from collections.abc import Iterator

import pytest
from get_browser import find_browser
from lab_page import LabPage
from playwright.sync_api import Browser, sync_playwright

from flexlab.lab.session import Session
from flexlab.presets import load_preset
from flexlab.sim.world import World

SOFTWARE_RENDERING = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """Compile the engine before the first lab, so that no test waits for it."""
    World(load_preset("paper")).advance(2)


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


@pytest.fixture
def session() -> Iterator[Session]:
    """The paper's lab on a free port, without shadows (they take most of a software renderer's time)."""
    with Session(load_preset("paper"), "paper", port=0, shadows=False) as lab:
        yield lab


@pytest.fixture
def page(chromium: Browser, session: Session) -> Iterator[LabPage]:
    """The lab opened in a browser window of 1440 x 900."""
    with LabPage(chromium, session) as opened:
        yield opened
