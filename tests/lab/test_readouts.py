"""What the head of the panel, the notices over the picture and the text for screen readers say about a run."""

import re
from dataclasses import replace

import numpy as np
import pytest
from lab_page import wait_until
from raw_browser import RawBrowser, html_texts, widget

from flexlab.analysis.explanations.explanation import Explained
from flexlab.guide import LOCKED, ClassRules
from flexlab.lab.lab_state import Notice
from flexlab.lab.panel.readouts import (
    SEEN_TOGETHER,
    events_html,
    largest_vibration,
    notices_html,
    number_html,
    status_html,
    summary_text,
)
from flexlab.lab.session import Session
from flexlab.lab.view_settings import ViewSettings
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import Pause, Play, Pull
from flexlab.sim.run_warnings import CURE
from flexlab.sim.runner import Runner
from flexlab.sim.snapshot import Event


def notices(scenario: Scenario) -> str:
    runner = Runner(scenario, playing=False)
    return notices_html(runner.snapshot, runner.recent(SEEN_TOGETHER), Notice(""), ClassRules())


def test_a_reset_or_another_preset_plays_after_a_run_that_stopped_but_not_in_a_paused_lab() -> None:
    with Session(load_preset("paper"), shadows=False) as lab, RawBrowser(lab) as browser:
        runner, reset = lab.runner, widget(lab, "Reset")
        for begin in (
            lambda: browser.update(reset, {"value": True}),
            lambda: browser.update(widget(lab, "Preset"), {"value": "smooth-start"}),
        ):
            wait_until(lambda: runner.snapshot.latest.time[0] > 0.1, "it runs")
            lab.lab_state.change({"payload.bending_stiffness": 0.001})
            wait_until(lambda: runner.snapshot.status.failed, "it stops")
            lab.lab_state.change({"payload.bending_stiffness": 100.0})
            number = runner.snapshot.run_number
            begin()
            wait_until(
                lambda number=number: runner.snapshot.run_number > number and runner.snapshot.latest.time[0] > 0.1,
                "it runs again",
            )
        lab.lab_state.submit(Pause())
        wait_until(lambda: not runner.snapshot.playing, "it stands")
        number = runner.snapshot.run_number
        browser.update(reset, {"value": True})
        wait_until(lambda: runner.snapshot.run_number > number, "a new run")
        assert not runner.snapshot.playing
        snapshot = replace(runner.snapshot, waiting=True)  # Nobody has drawn the new run yet.
        assert "Paused" in status_html(snapshot, lab.lab_state.view, (), "")
        stepping = status_html(replace(runner.snapshot, steps_left=2500), lab.lab_state.view, (), "")
        assert "Running" in stepping
        assert "as fast as possible, to t = 2.5 s" in stepping
        for reached, late in ((0.998, False), (0.97, True)):  # "too slow: 1 × / 1.00 ×" contradicted itself.
            slow = replace(runner.snapshot, too_slow=True, target_speed=1.0, actual_speed=reached)
            assert ("too slow" in status_html(slow, lab.lab_state.view, (), "")) is late


def test_a_locked_lab_says_so_only_once_even_after_a_refused_request() -> None:
    runner, rules = Runner(load_preset("paper"), playing=False), ClassRules(locked=True)
    recent = runner.recent(SEEN_TOGETHER)
    said = [notices_html(runner.snapshot, recent, notice, rules) for notice in (Notice(""), Notice(LOCKED, "error"))]
    assert [shown.count(LOCKED) for shown in said] == [1, 1]


@pytest.mark.parametrize(("pressed", "stands"), [(1, False), (600, True)])
def test_a_load_that_the_model_neglects_is_a_standing_warning_only_while_it_lasts(pressed: int, stands: bool) -> None:
    """The jerk at the start of `single-arm` presses its beam for a moment; the warning stood for the whole run."""
    snapshot = Runner(load_preset("single-arm"), playing=False).snapshot
    assert snapshot.model_warning.endswith(CURE)
    recent = snapshot.latest.take(np.zeros(1000, int))
    recent = recent.having(axial_load_share=np.where(np.arange(1000) < pressed, 0.2, 0.0))
    assert ("pressed" in notices_html(snapshot, recent, Notice(""), ClassRules())) is stands


def test_a_large_deflection_is_told_until_it_has_been_over_for_a_second() -> None:
    """The warning of `spin-up`, whose beam bends by 8 % for half a second, stood for the whole run."""
    snapshot = Runner(bent_at_its_free_end(0.063), playing=False).snapshot
    straight = snapshot.latest.having(beam_coordinates=0.2 * snapshot.latest.beam_coordinates)
    for recent, stands in ((snapshot.latest, True), (straight, False)):
        assert ("Large deflection" in notices_html(snapshot, recent, Notice(""), ClassRules())) is stands


def bent_at_its_free_end(share: float) -> Scenario:
    """A beam in one arm, bent like a parabola: the free end is `share` L off the axis, the middle a quarter of that."""
    arm = load_preset("single-arm").replace({"payload.element_count": 2})
    length = arm.payload.length
    shape = [(share * s**2 * length, 2 * share * s) for s in (0.5, 1.0)]
    return arm.replace({"initial.beam_coordinates": [value for node in shape for value in node]})


def test_a_free_end_that_bends_too_far_is_flagged():
    """6.3 % of L at the end are 1.6 % at mid-span."""
    assert "Large deflection: |w|/L was up to 6.3\xa0%, at t\xa0=\xa00.000\xa0s, above 5\xa0%" in notices(
        bent_at_its_free_end(0.063)
    )
    assert "Large deflection" not in notices(bent_at_its_free_end(0.045))


@pytest.mark.parametrize(("share", "flagged"), [(0.045, False), (0.055, True)])
def test_large_bending_away_from_the_middle_is_flagged(share: float, flagged: bool):
    """One wave along a beam held by two arms: its middle stays on the axis."""
    paper = load_preset("paper").replace({"payload.element_count": 4})
    crest = share * paper.payload.length
    shape = (0.0, crest, 0.0, 0.0, 0.0, -crest, 0.0, 0.0)
    world = paper.replace({"initial.beam_coordinates": shape})
    assert ("Large deflection" in notices(world)) is flagged


def test_the_text_for_screen_readers_tells_run_warnings_and_explanations():
    runner = Runner(bent_at_its_free_end(0.063), playing=False)
    shown = Explained("ringing", "The beam rings.", "w = q sin ωt", "Deflection")
    told = summary_text(runner.snapshot, runner.recent(SEEN_TOGETHER), [shown])
    assert told.startswith(
        f"{runner.snapshot.scenario.title}: One arm holds a flexible beam. Paused at t = 0.00 s, speed 1 ×. "
    )
    assert "first beam frequency" in told
    assert "Large deflection: |w|/L was up to 6.3 %, at t = 0.000 s" in told
    assert told.endswith(" Deflection: The beam rings.")


@pytest.mark.parametrize(
    ("preset", "said"),
    [("paper", "grips held"), ("squeeze-until-it-buckles", "no axial force"), ("spin-up", "no axial force")],
)
def test_a_frequency_computed_without_axial_force_says_so(preset: str, said: str):
    """The squeezed beam rings at 3.2 Hz, while the readout says 5.01 Hz."""
    runner = Runner(load_preset(preset), playing=False)
    assert f"first beam frequency f<sub>1</sub>, {said}</span>" in status_html(runner.snapshot, ViewSettings(), (), "")
    for shown in (number_html, lambda recent, snapshot: summary_text(snapshot, recent, [])):
        assert ("no axial force" in shown(runner.recent(SEEN_TOGETHER), runner.snapshot)) == (preset != "paper")


def test_bending_by_a_hand_is_not_counted_as_vibration():
    run = Runner(load_preset("paper"), playing=False).recent(SEEN_TOGETHER)
    held = run.having(midspan_deflection=run.quasi_static_deflection + 0.005)
    pull = Pull(0.0, (0.0, 0.8), 500.0)
    assert largest_vibration(held, ()) == "5.00 mm"
    for bent, said in ((4e-4, "0.40 mm"), (4e-5, "40.0 µm")):
        assert largest_vibration(run.having(midspan_deflection=run.quasi_static_deflection + bent), ()) == said
    assert largest_vibration(held, [Event(0.0, "", pull)]) == "0.0 µm"
    assert largest_vibration(held, [Event(-1.0, "", replace(pull, stiffness=0.0))]) == "5.00 mm", "it has let go before"


def test_a_run_that_stopped_gives_each_advice_once() -> None:
    """A loop that ran away was also said to depend on rounding, with the same advice, and its beam to need it twice."""
    sampled = {"kind": "pd", "control_period": 0.02}
    runner = Runner(load_preset("paper").replace({"controller": sampled}), "sampled")
    runner.submit(Play())
    wait_until(lambda: runner.frame() or runner.snapshot.status.failed, "it stops")
    assert "lower gains" in runner.snapshot.accuracy_warning
    assert runner.snapshot.model_warning.count(CURE) == 2
    told = notices_html(runner.snapshot, runner.recent(SEEN_TOGETHER), Notice(""), ClassRules())
    assert (told.count("ran away"), told.count("lower gains"), told.count(CURE)) == (1, 1, 1)


def test_a_drag_is_one_event_and_ends_where_the_beam_is_let_go():
    pull = Pull(0.0, (0.0, 0.8), 500.0)
    loose = replace(pull, stiffness=0.0)
    told = [Event(0.1 * number, f"event {number}", each) for number, each in enumerate((pull, pull, loose, pull, pull))]
    shown = events_html(replace(Runner(Scenario(), playing=False).snapshot, events=tuple(told)))
    assert re.findall(r"event \d", shown) == ["event 4", "event 2", "event 1"]


def test_a_warning_that_goes_on_is_shown_only_once():
    """It used to be shown a second time as an event, with the numbers of that instant."""
    pressed = load_preset("squeeze-until-it-buckles").replace({"payload.axial_load": "none"})
    with Session(pressed, shadows=False) as session, RawBrowser(session):

        def boxes() -> str:
            told = [html.content for html in html_texts(session) if 'class="fl fl-float"' in html.content]
            return told[0] if told else ""

        wait_until(lambda: any("The beam was pressed" in event.text for event in session.runner.snapshot.events), "it")
        wait_until(lambda: "The beam was pressed" in boxes(), "the warning is shown")
        assert session.lab_state.notice.text == ""
        assert boxes().count("fl-caution") == boxes().count("fl-box") == 1
