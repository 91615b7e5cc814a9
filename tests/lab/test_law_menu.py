"""A law that needs sampled control can be chosen under continuous control: the lab sets a period, says so, and can undo it."""

from contextlib import suppress

from lab_page import wait_until
from raw_browser import RawBrowser, widget

from flexlab.lab.session import Session
from flexlab.presets import load_preset
from flexlab.scenario.field_text import in_words


def test_the_menu_gives_lqr_a_control_period_and_says_so(session: Session) -> None:
    with RawBrowser(session) as browser:
        browser.update(widget(session, "Control law"), {"value": "Linear-quadratic regulator · lqr"})
        wait_until(lambda: session.runner.snapshot.scenario.controller.kind == "lqr", "the law is taken", 60)
        assert session.runner.snapshot.scenario.controller.control_period == 0.001
        said = "lqr acts at control instants: controller.control_period was set to 0.001 s."
        wait_until(lambda: session.lab_state.notice.text == said, "the lab says so", 60)
        session.lab_state.undo()
        assert session.lab_state.intended == session.lab_state.baseline


def test_a_menu_offers_what_the_present_law_accepts(session: Session) -> None:
    """Under lqr it offered measured rates, which only composite takes, and refused them."""

    def observers() -> tuple[str, ...]:
        with suppress(StopIteration):  # Before the first picture of the new run there is no such menu.
            return widget(session, "Observer").options
        return ()

    with RawBrowser(session):
        for name, offered in (("lqr", ["kalman"]), ("composite", ["measured", "kalman"])):
            session.lab_state.load(load_preset(name), name)
            words = tuple(map(in_words, offered))
            wait_until(lambda words=words: observers() == words, f"{name} has {offered}", 60)
