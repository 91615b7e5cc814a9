"""A law that needs sampled control can be chosen under continuous control: the lab sets a period, says so, and can undo it."""

from lab_page import wait_until
from raw_browser import RawBrowser, widget

from flexlab.lab.session import Session


def test_the_menu_gives_lqr_a_control_period_and_says_so(session: Session) -> None:
    with RawBrowser(session) as browser:
        browser.update(widget(session, "Control law"), {"value": "Linear-quadratic regulator · lqr"})
        wait_until(lambda: session.runner.snapshot.scenario.controller.kind == "lqr", "the law is taken", 60)
        assert session.runner.snapshot.scenario.controller.control_period == 0.001
        said = "lqr acts at control instants: controller.control_period was set to 0.001 s."
        wait_until(lambda: session.lab_state.notice.text == said, "the lab says so", 60)
        session.lab_state.undo()
        assert session.lab_state.intended == session.lab_state.baseline
