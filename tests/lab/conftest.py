"""Real labs and a real headless Chromium for the tests of the lab."""

from collections.abc import Iterator

import pytest
from lab_page import LabPage
from playwright.sync_api import Browser

from flexlab.lab.session import Session
from flexlab.presets import load_preset
from flexlab.sim.world import World


@pytest.fixture(scope="session", autouse=True)
def _compiled() -> None:
    """Compile the engine before the first lab, so that no test waits for it."""
    World(load_preset("paper")).advance(2)


@pytest.fixture
def session() -> Iterator[Session]:
    """The paper's lab on a free port, without shadows (they take most of a software renderer's time)."""
    with Session(load_preset("paper"), "paper", port=0, shadows=False) as lab:
        yield lab


@pytest.fixture(scope="module")
def shared_session() -> Iterator[Session]:
    """The same, one for all tests of a file that leave it as it was."""
    with Session(load_preset("paper"), "paper", port=0, shadows=False) as lab:
        yield lab


@pytest.fixture
def page(chromium: Browser, session: Session) -> Iterator[LabPage]:
    """The lab opened in a browser window of 1440 x 900."""
    with LabPage(chromium, session) as opened:
        yield opened
