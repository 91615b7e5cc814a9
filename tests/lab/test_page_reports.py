"""Pages report what they show, and labs act on it: runs begin when they are drawn, and pause when nobody looks."""

import re

import pytest
from lab_page import wait_until
from raw_browser import RawBrowser, page_report

from flexlab.lab.page_reports import PageReports
from flexlab.lab.session import Attendance, Session
from flexlab.presets import load_preset
from flexlab.sim.commands import Pause, Reset


def way(session: Session) -> object:
    """The hidden widget by which the only browser sends its reports."""
    (client,) = session.server.get_clients().values()
    return next(handle for handle in client.gui._gui_input_handle_from_uuid.values())


def report(browser: RawBrowser, session: Session, run: int, **charts: tuple[float, float]) -> None:
    wait_until(session.server.get_clients, "the browser is a client", 20)
    wait_until(lambda: next(iter(session.server.get_clients().values())).gui._gui_input_handle_from_uuid, "its way", 20)
    browser.update(way(session), {"value": page_report(run, charts=charts)})


def time_of(session: Session) -> float:
    return float(session.runner.snapshot.latest.time[0])


def test_a_run_begins_when_a_page_has_drawn_it() -> None:
    with Session(load_preset("paper"), "paper", shadows=False, attended=True) as session:
        with RawBrowser(session) as browser:
            report(browser, session, 0)
            with pytest.raises(AssertionError):
                wait_until(lambda: time_of(session) > 0, "time passes", 0.6)
            report(browser, session, 1)
            wait_until(lambda: time_of(session) > 0.1, "time passes", 20)
            session.runner.submit(Reset())
            wait_until(lambda: session.runner.snapshot.run_number == 2, "a new run", 20)
            with pytest.raises(AssertionError):
                wait_until(lambda: time_of(session) > 0, "time passes", 0.6)
            report(browser, session, 2)
            wait_until(lambda: time_of(session) > 0.1, "time passes", 20)


@pytest.mark.parametrize("text", ["", "{}", "[]", '{"run": -1, "charts": {}, "dark": false}', "9" * 9000, "{" * 9000])
def test_a_malformed_report_is_ignored(session: Session, text: str) -> None:
    with RawBrowser(session) as browser:
        report(browser, session, 1, some=(0.0, 0.5))
        reports: PageReports = session._reports
        wait_until(lambda: reports.open_charts() == {"some": (0.0, 0.5)}, "the report is heard", 20)
        browser.update(way(session), {"value": text})
        report(browser, session, 1, other=(0.1, 0.2))
        wait_until(lambda: reports.open_charts() == {"other": (0.1, 0.2)}, "the next report is heard", 20)


def test_charts_that_nobody_sees_are_not_sent(session: Session) -> None:
    plots = session._plots
    (first, *others) = plots._charts
    with RawBrowser(session) as browser:
        report(browser, session, 1, **{first.uuid: (0.0, 1.0)})
        wait_until(lambda: plots._opened == {first.uuid: (0.0, 1.0)}, "the report is heard", 20)
        before = [len(chart._handle.data[0]) for chart in others]
        shown = first._handle.data[1]
        wait_until(lambda: first._handle.data[1] is not shown, "the open chart goes on", 20)
        wait_until(lambda: time_of(session) > 1, "time passes", 20)
        assert [len(chart._handle.data[0]) for chart in others] == before


def test_a_chart_that_is_opened_again_has_the_range_of_what_it_shows(session: Session) -> None:
    """Opened while the run was paused, the torques' axis had room for the jerk of the start."""
    plots = session._plots
    session.lab_state.set_view(plot_window=0.5, follow_speed=False)
    (torque,) = (chart for chart in plots._charts if chart._plot.title == "Joint torques, left arm")
    with RawBrowser(session) as browser:
        report(browser, session, 1, **{torque.uuid: (0.0, 1.0)})
        session.runner.submit(Reset())
        wait_until(lambda: torque._span.ends[0] < -500, "the jerk of the start is drawn", 20)
        report(browser, session, 2)
        wait_until(lambda: plots._opened == {}, "the chart is closed", 20)
        wait_until(lambda: time_of(session) > 2, "the start is out of the window", 20)
        session.runner.submit(Pause())
        wait_until(lambda: not session.runner.snapshot.playing, "it stands", 20)
        assert torque._span.ends[0] < -500
        report(browser, session, 2, **{torque.uuid: (0.0, 1.0)})
        wait_until(lambda: torque._span.ends[0] > -200, "its axis fits the present torques", 20)


def test_a_lab_that_nobody_watches_pauses_until_somebody_comes(session: Session) -> None:
    clock = [0.0]
    reports: PageReports = session._reports
    attendance = Attendance(session.lab_state, reports, longest=60.0, clock=lambda: clock[0])
    clock[0] = 59.0
    attendance.update()
    assert session.runner.snapshot.playing
    clock[0] = 61.0
    attendance.update()
    wait_until(lambda: not session.runner.snapshot.playing, "the lab holds", 20)
    with RawBrowser(session) as browser:
        report(browser, session, 1)
        wait_until(lambda: reports.count, "somebody looks", 20)
        attendance.update()
        wait_until(lambda: session.runner.snapshot.playing, "the lab goes on", 20)
        assert re.search(r"paused at t = \S+ s while nobody watched", session.lab_state.notice.text)


def test_a_run_that_a_person_paused_stays_paused(session: Session) -> None:
    from flexlab.sim.commands import Pause

    clock = [0.0]
    reports: PageReports = session._reports
    attendance = Attendance(session.lab_state, reports, longest=60.0, clock=lambda: clock[0])
    session.runner.submit(Pause())
    wait_until(lambda: not session.runner.snapshot.playing, "the lab holds", 20)
    clock[0] = 600.0
    attendance.update()
    with RawBrowser(session) as browser:
        report(browser, session, 1)
        wait_until(lambda: reports.count, "somebody looks", 20)
        attendance.update()
        with pytest.raises(AssertionError):
            wait_until(lambda: session.runner.snapshot.playing, "the lab goes on", 0.5)


def test_choosing_a_preset_very_often_begins_few_runs(session: Session) -> None:
    with RawBrowser(session) as browser:
        report(browser, session, 1)
        begun = session.runner.snapshot.run_number
        for again in range(1, 501):
            browser.update(way(session), {"value": page_report(1, dark=again == 500, again=again)})
        reports: PageReports = session._reports
        wait_until(
            lambda: [page.report.again for page in reports._pages.values() if page.report] == [500], "all are heard", 30
        )
        asked = session.lab_state._asked
        session.runner.submit(Reset())
        wait_until(lambda: session.runner.snapshot.answered > asked, "all is done", 30)
        assert 2 <= session.runner.snapshot.run_number - begun <= 8, "one at once, one a second, and the reset"
