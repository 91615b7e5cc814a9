"""A lab that the teacher has locked stays as it is, whatever a student's browser sends."""

import json
from pathlib import Path
from typing import Any

import pytest
from lab_page import wait_until
from raw_browser import RawBrowser
from test_page_reports import report, way

from flexlab.guide import LOCKED, ClassRules
from flexlab.lab.session import Session
from flexlab.lab.viser_internals import input_state
from flexlab.sim.commands import Pause

TOUCH = {"instance_index": 0, "modifier": None, "owner": "", "button": "left"}
PLACE = {"start_position": [0.0, 0.75, 0.1], "start_screen_pos": [0.5, 0.5], "end_screen_pos": [0.6, 0.6]}


def another_value(handle: Any) -> Any:
    """A value of a widget that a person could choose, other than the present one."""
    _, present, is_button, options = input_state(handle)
    if is_button or isinstance(present, bool):
        return True if is_button else not present
    if options is not None:
        return next((option for option in options if option != present), present)
    if isinstance(present, (int, float)):
        return present + 1
    return "other" if isinstance(present, str) else present


def test_nothing_that_a_student_does_changes_a_locked_lab(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # A student may save the scenario: here.
    lab_state = session.lab_state
    with RawBrowser(session) as browser:
        report(browser, session, 1)
        lab_state.submit(Pause())
        wait_until(lambda: not session.runner.snapshot.playing and lab_state.playing is False, "it is paused", 20)
        lab_state.rules = ClassRules(locked=True)
        before, asked = session.runner.snapshot, lab_state._asked
        own = way(session)
        for handle in list(session.server.gui._gui_input_handle_from_uuid.values()):
            browser.update(handle, {"value": another_value(handle)})
            browser.send({"type": "GuiButtonHoldMessage", "uuid": handle._impl.uuid, "frequency": 10.0})
        for uuid in list(session.server.gui._command_handle_from_uuid):
            browser.send({"type": "CommandTriggerMessage", "uuid": uuid})
        for name in list(session.server.scene._handle_from_node_name):
            for phase in ("start", "update", "end"):
                drag = {"type": "SceneNodeDragMessage", "phase": phase, "name": name, "end_position": [0.2, 0.9, 0.1]}
                browser.send(drag | TOUCH | PLACE)
        told = {
            "run": 1,
            "charts": {},
            "dark": False,
            "width": 1440,
            "covered": [0, 0],
            "height": 900,
            "open": [],
            "hears": False,
            "again": 7,
        }
        browser.update(own, {"value": json.dumps(told)})
        heard = session._reports
        wait_until(
            lambda: [page.report.again for page in heard._pages.values() if page.report] == [7], "all is heard", 60
        )
        assert lab_state.notice.text == LOCKED
    assert lab_state._asked == asked, "no command came to the engine"
    now = session.runner.snapshot
    assert (now.run_number, now.playing, now.scenario) == (before.run_number, False, before.scenario)
    assert float(now.latest.time[0]) == float(before.latest.time[0])
    assert lab_state.intended == before.scenario
