"""Real labs and a real headless Chromium for the tests of the lab."""

from collections.abc import Iterator

import pytest
from browser_window import BY_THE_PROCESSOR, PAUSE, SOFTWARE_RENDERING
from get_browser import find_browser
from lab_page import LabPage, LastingWindow, wait_until
from playwright.sync_api import Browser

from flexlab.lab import render_loop
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
def lasting_session(shared_session: Session) -> Session:
    """That one, when nobody looks at it and without what it said and counted."""
    wait_until(lambda: not shared_session.server.get_clients(), "the last browser has left", 20)
    shared_session.guard.refused = 0
    shared_session.lab_state.say("")
    return shared_session


@pytest.fixture(scope="session")
def chromium(chromium: Browser) -> Iterator[Browser]:
    """A browser that draws pages of the lab, and only those, cheaply."""
    arguments = [*SOFTWARE_RENDERING, BY_THE_PROCESSOR]
    browser = chromium.browser_type.launch(executable_path=find_browser(), args=arguments)
    yield browser
    browser.close()


@pytest.fixture(scope="module")
def window(chromium: Browser) -> Iterator[LastingWindow]:
    """One window of 1440 x 900 for all tests of a file; labs send it as many pictures as it draws."""
    lasting = LastingWindow(chromium)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(render_loop, "FRAME_TIME", PAUSE / 1000)
        patch.setattr(render_loop, "READOUT_EVERY", 1)
        yield lasting
    lasting.close()


@pytest.fixture
def page(window: LastingWindow, request: pytest.FixtureRequest) -> Iterator[LabPage]:
    """A new lab of the paper in a browser window."""
    failed = request.session.testsfailed
    with Session(load_preset("paper"), "paper", port=window.port, shadows=False) as lab:
        yield window.show(lab)
    if request.session.testsfailed > failed:
        window.close()  # Nobody knows how the page was left.
