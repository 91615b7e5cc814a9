"""Looking back at the last minute of a running lab, and continuing from there."""

from dataclasses import fields

import numpy as np
import pytest
from lab_page import wait_until
from raw_browser import RawBrowser, widget

from flexlab.errors import LabError
from flexlab.guide import LOCKED, ClassRules
from flexlab.lab.lab_state import BY_PERSON, Outside
from flexlab.lab.look_back import LookBack
from flexlab.lab.session import Session
from flexlab.sim.commands import Pause, Play, Reset, SetSpeed, Tap
from flexlab.sim.samples import Samples


@pytest.fixture
def look_back(session: Session) -> LookBack:
    """The look back of a lab that has run for half a second."""
    wait_until(lambda: session.runner.snapshot.latest.time[0] > 0.5, "the run goes on")
    session.lab_state.outside = Outside(recorded_as=lambda: "2026-01-01T00-00-00-paper")
    return LookBack(session.lab_state)


def answered(session: Session) -> None:
    runner = session.runner
    wait_until(lambda: runner.snapshot.answered >= session.lab_state._asked, "the engine has answered")


def test_the_run_pauses_while_somebody_looks_back_and_goes_on_afterwards(session: Session, look_back: LookBack) -> None:
    look_back.look(0.2)
    answered(session)
    now = session.runner.snapshot
    assert not now.playing
    seen = look_back.seen(now)
    assert seen.latest.time[0] == pytest.approx(now.latest.time[0] - 0.2)
    assert seen.display is seen.latest
    look_back.look(0.3)
    assert look_back.recent(0.1).time[-1] == pytest.approx(now.latest.time[0] - 0.3)
    look_back.look(1e6)
    assert look_back.seen(now).latest.time[0] == 0.0, "no farther than its beginning"
    look_back.back_to_now()
    answered(session)
    assert session.runner.snapshot.playing
    assert look_back.seen(session.runner.snapshot).latest is session.runner.snapshot.latest


def test_a_run_that_was_paused_before_stays_paused_after_looking_back(session: Session, look_back: LookBack) -> None:
    session.lab_state.submit(Pause())
    answered(session)
    look_back.look(0.1)
    look_back.look(0.0)
    answered(session)
    assert not session.runner.snapshot.playing


def test_at_the_start_of_a_run_the_bar_stays_and_there_is_no_past(session: Session, look_back: LookBack) -> None:
    with RawBrowser(session):
        bar = wait_until(lambda: widget(session, "Look back"), "the bar")
        session.lab_state.submit(Pause())
        session.lab_state.submit(Reset())
        wait_until(lambda: bar.min == pytest.approx(-0.02), "it spans next to nothing")
        assert bar.visible
        look_back.look(0.5)
        session.lab_state.submit(Play())
        wait_until(lambda: look_back.reach > 1.0, "the run goes on")
        assert look_back.ago == 0.0


@pytest.mark.parametrize("command", [Play(), Reset(), SetSpeed(0.5), Tap(0.25, (0.0, 0.1))])
def test_any_other_command_ends_looking_back(session: Session, look_back: LookBack, command) -> None:
    look_back.look(0.2)
    answered(session)
    assert look_back.ago == 0.2
    session.lab_state.submit(command)
    answered(session)
    assert look_back.ago == 0.0


def test_a_run_continues_from_the_shown_instant_with_exactly_its_state(session: Session, look_back: LookBack) -> None:
    session.lab_state.submit(Tap(0.25, (0.0, 0.5)))
    answered(session)
    session.lab_state.change({"payload.bending_stiffness": 50.0})
    answered(session)
    with pytest.raises(LabError, match="look back first"):
        look_back.go_on()
    look_back.look(0.4)
    answered(session)
    shown = look_back.seen(session.runner.snapshot)
    assert shown.scenario.payload.bending_stiffness == 100.0, "as it was before the change"
    look_back.go_on()
    answered(session)
    now = session.runner.snapshot
    assert now.run_number == 2
    assert now.start_time == pytest.approx(float(shown.latest.time[0]))
    assert now.scenario == shown.scenario == session.lab_state.intended
    assert now.playing
    assert f"Go on from 2026-01-01T00-00-00-paper at t = {now.start_time:.3f} s" in now.events[0].text
    assert session.lab_state.baseline.payload.bending_stiffness == 100.0
    wait_until(lambda: session.runner.snapshot.latest.time[0] > now.start_time + 0.1, "it goes on")
    session.lab_state.submit(Pause())
    answered(session)
    run = session.runner.recent(60.0)
    for signal in fields(Samples):
        assert np.array_equal(getattr(run, signal.name)[0], getattr(shown.latest, signal.name)[0]), signal.name


def test_a_paused_lab_that_is_locked_can_be_looked_back_at_but_not_continued(
    session: Session, look_back: LookBack
) -> None:
    session.lab_state.submit(Pause())
    answered(session)
    session.lab_state.rules = ClassRules(locked=True)
    token = BY_PERSON.set(True)  # The lock binds only people.
    try:
        look_back.look(0.2)
        assert look_back.ago == 0.2
        with pytest.raises(LabError, match=LOCKED):
            look_back.go_on()
    finally:
        BY_PERSON.reset(token)
    assert session.runner.snapshot.run_number == 1
