"""A window that shows one lab after another."""

from lab_page import LabPage
from playwright.sync_api import Browser, Error

from flexlab.lab.session import Session
from flexlab.own import hosts
from flexlab.presets import load_preset
from flexlab.sim.commands import Pause
from flexlab.sockets import free_ports


class LastingWindow:
    """A window that shows one session after another, on the same port: a new window takes longer than most tests."""

    def __init__(self, browser: Browser):
        self._browser = browser
        self._page: LabPage | None = None
        self._session: Session | None = None
        (self.port,) = free_ports(1)

    def lab(self, plays: bool = True) -> LabPage:
        """The page, showing the paper's run from its start, in the last test's lab if there is one; paused unless it `plays`."""
        if self._session is not None and self._page is not None:
            hosts.run_apart()  # As when the lab started; undone after each test.
            self._page.begin_anew(plays)
            return self._page
        self._session = Session(load_preset("paper"), "paper", port=self.port, playing=plays, shadows=False)
        self._session.start()
        return self.show(self._session)

    def show(self, session: Session) -> LabPage:
        """The page, showing this session."""
        if self._page is not None:
            try:
                self._page.come_back(session)
            except Error:  # The last test left the page in an unknown state: open another.
                self._page.__exit__()
                self._page = None
        if self._page is None:
            self._page = LabPage(self._browser, session).__enter__()
        return self._page

    def adopt(self, session: Session) -> None:
        """Take a session that the page shows already, instead of the last one, which has ended, for the tests that follow."""
        self._session = session
        if self._page is not None:
            self._page.session = session

    def keep(self) -> None:
        """Keep the lab for the tests of the next file, at rest, unless somebody has begun a lesson, which begins only once."""
        if self._session is None or self._page is None or self._session.lab_state.lessons:
            self.rest()
        else:
            self._session.lab_state.submit(Pause())
            self._page.rest()

    def rest(self) -> None:
        """End the last lab; its page draws nothing until it shows another one."""
        if self._session is not None:
            self._session.stop()
        self._session = None
        if self._page is not None:
            try:
                self._page.rest()
            except Error:  # The page shows something else, or is closed: open another.
                self._page.__exit__()
                self._page = None

    def close(self) -> None:
        """Close the window; the next session gets a new one, on another port."""
        self.rest()
        if self._page is not None:
            self._page.__exit__()
        self._page = None
        (self.port,) = free_ports(1)
