"""Real labs and a real headless Chromium for the tests of the lab."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser_window import PAUSE
from lab_page import LabPage, LastingWindow, wait_until
from playwright.sync_api import Browser
from waiting import PATIENCE

from flexlab.lab import lab_state
from flexlab.lab import session as lab_session
from flexlab.lab.panel import number_control, panel
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
    with Session(load_preset("paper"), "paper", shadows=False) as lab:
        yield lab


@pytest.fixture
def soon_put_right(monkeypatch: pytest.MonkeyPatch) -> None:
    """A number that was refused stands in its box for one second, not for four."""
    monkeypatch.setattr(number_control, "SETTLE_TIME", 1.0)


@pytest.fixture(scope="module")
def shared_session() -> Iterator[Session]:
    """The same, one for all tests of a file that leave it as it was."""
    with Session(load_preset("paper"), "paper", shadows=False) as lab:
        yield lab


@pytest.fixture
def lasting_session(shared_session: Session) -> Session:
    """That one, when nobody looks at it and without what it said and counted."""
    wait_until(lambda: not shared_session.server.get_clients(), "the last browser has left", 20)
    shared_session.guard.refused = 0
    shared_session.lab_state.say("")
    return shared_session


@pytest.fixture(scope="session")
def chromium(plain_chromium: Browser) -> Browser:
    """A browser that draws pages of the lab, and only those, cheaply."""
    return plain_chromium


@pytest.fixture(scope="session")
def _lasting_window(chromium: Browser) -> Iterator[LastingWindow]:
    """One window of 1440 x 900 for all tests."""
    lasting = LastingWindow(chromium)
    yield lasting
    lasting.close()


NEXT = pytest.StashKey[pytest.Item | None]()
"""The test that follows."""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Remember which test follows: the window stays open for tests of the lab."""
    item.session.stash[NEXT] = nextitem


@pytest.fixture(scope="module")
def window(_lasting_window: LastingWindow, request: pytest.FixtureRequest) -> Iterator[LastingWindow]:
    """The window, while labs send as many pictures as it draws."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lab_session, "FRAME_TIME", PAUSE / 1000)
        patch.setattr(lab_session, "READOUT_EVERY", 1)
        patch.setattr(lab_state, "NOTICE_TIME", PATIENCE)  # A busy page may draw a sentence late.
        for module in (number_control, panel):
            patch.setattr(module, "READING_TIME", PATIENCE)
        yield _lasting_window
        follows = request.session.stash[NEXT]
        if follows is None or Path(__file__).parent not in follows.path.parents:
            _lasting_window.close()
        else:
            _lasting_window.rest()  # A file's tests leave their lab as they like, drawn a thousandfold for instance.


@pytest.fixture
def page(window: LastingWindow, request: pytest.FixtureRequest) -> Iterator[LabPage]:
    """The paper's run from its beginning in the window, in the last test's lab: a page takes seconds to show a new one."""
    failed = request.session.testsfailed
    yield window.lab()
    if request.session.testsfailed > failed:
        window.close()  # Nobody knows how the page was left.


@pytest.fixture
def new_lab(window: LastingWindow) -> None:
    """The page's lab is a new one (`usefixtures`): for tests that begin with what only a new lab is like."""
    window.rest()
