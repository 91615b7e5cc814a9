"""Real labs and a real headless Chromium for the tests of the lab."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from lab_page import LabPage, wait_until
from lasting_window import LastingWindow
from playwright.sync_api import Browser
from waiting import PATIENCE

from flexlab.lab import lab_state
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
    """A lab with the paper's preset on a free port, without shadows (which take most of a software renderer's time)."""
    with Session(load_preset("paper"), "paper", shadows=False) as lab:
        yield lab


@pytest.fixture
def soon_put_right(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a box show a refused number for one second instead of four."""
    monkeypatch.setattr(number_control, "SETTLE_TIME", 1.0)


@pytest.fixture(scope="module")
def shared_session() -> Iterator[Session]:
    """One such lab for all tests of a file, which leave it as they found it."""
    with Session(load_preset("paper"), "paper", shadows=False) as lab:
        yield lab


@pytest.fixture
def lasting_session(shared_session: Session) -> Session:
    """The shared lab once the last browser has left, without its notice and its count of refused messages."""
    wait_until(lambda: not shared_session.server.get_clients(), "the last browser has left", 20)
    shared_session.guard.refused = 0
    shared_session.lab_state.say("")
    return shared_session


@pytest.fixture(scope="session")
def chromium(plain_chromium: Browser) -> Browser:
    """A browser that draws pages of the lab cheaply, and no others."""
    return plain_chromium


@pytest.fixture(scope="session")
def _lasting_window(chromium: Browser) -> Iterator[LastingWindow]:
    """One window of 1440 x 900 for all tests."""
    lasting = LastingWindow(chromium)
    yield lasting
    lasting.close()


NEXT = pytest.StashKey[pytest.Item | None]()
"""Key of the test that runs next."""


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Remember which test runs next: the window stays open if that is a test of the lab."""
    item.session.stash[NEXT] = nextitem


@pytest.fixture(scope="module")
def window(
    _lasting_window: LastingWindow, few_pictures: None, request: pytest.FixtureRequest
) -> Iterator[LastingWindow]:
    """The window, with labs that send few pictures."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lab_state, "NOTICE_TIME", PATIENCE)  # A busy page may draw a sentence late.
        for module in (number_control, panel):
            patch.setattr(module, "READING_TIME", PATIENCE)
        yield _lasting_window
        follows = request.session.stash[NEXT]
        if follows is None or Path(__file__).parent not in follows.path.parents:
            _lasting_window.close()
        else:
            _lasting_window.keep()


@pytest.fixture
def page(window: LastingWindow, request: pytest.FixtureRequest) -> Iterator[LabPage]:
    """The window with the paper's run from its start, in the last test's lab: a page takes seconds to show a new lab."""
    failed = request.session.testsfailed
    yield window.lab(plays="still" not in request.fixturenames)
    if request.session.testsfailed > failed:
        window.close()  # The state of the page is unknown.


@pytest.fixture
def still() -> None:
    """Hold the run of `page` at its start (`usefixtures`): a page that shows a motion costs three times as much."""


@pytest.fixture
def new_lab(window: LastingWindow) -> None:
    """Start a new lab for the page (`usefixtures`), for tests that need the state of a new one."""
    window.rest()
