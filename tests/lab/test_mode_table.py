"""The mode table says which loop its poles belong to, marks unstable poles, and shows the margins."""

import re
import threading

import pytest
from lab_page import wait_until
from raw_browser import RawBrowser, html_texts, widget

from flexlab.analysis.modes import modes
from flexlab.lab.mode_computation import ModeStudy
from flexlab.lab.panel.mode_table import MOST_POLES, modes_html
from flexlab.lab.session import Session
from flexlab.presets import load_preset
from flexlab.sim.commands import Reset

SAMPLED = {
    "payload.element_count": 8,
    "payload.damping.kind": "modal",
    "payload.damping.ratio": 0.0,
    "controller.control_period": 1e-3,
    "controller.input_delay": 1,
}


def test_unstable_poles_are_marked_in_words_and_colour():
    text = modes_html(modes(load_preset("vibration-damping").replace(SAMPLED)))
    assert "Poles of the sampled loop" in text
    assert "sampled at 1 ms, torques 1 sample late" in text
    assert "Unstable: small motions grow at 2.65 1/s." in text
    marked = re.findall(r'<span class="fl-bad">([^<]*)</span>', text.split("</table>")[1])
    assert marked[:4] == ["400.99", "−0.11", "2.65 grows", "beam mode 3"]
    assert "none: unstable" in text
    assert len(re.findall(r"<tr", text.split("Poles of")[1].split("</table>")[0])) == 1 + MOST_POLES


def test_a_stable_loop_shows_its_margins():
    text = modes_html(modes(load_preset("paper")))
    assert "Poles of the continuous loop" in text
    assert "grows" not in text
    assert "45.54" in text
    assert re.search(r"all alike</td><td>× 0.\d+ – \d\.\d, ±\d+°", text)


def test_without_a_rest_point_the_table_says_so_and_keeps_the_beams_modes():
    text = modes_html(modes(load_preset("gravity").replace({"controller.kind": "none"})))
    assert "no rest point" in text
    assert "Beam with its grips held" in text


def test_the_modes_of_a_beam_under_axial_force_say_that_they_leave_it_out():
    found = modes(load_preset("squeeze-until-it-buckles"))
    assert str(found).startswith("Beam with its grips held, no axial force\n")
    text = modes_html(found)
    beam, poles = text.split("Poles of")
    assert "Beam with its grips held, no axial force" in beam
    assert '<td class="fl-figure">5.01</td>' in beam
    assert '<td class="fl-figure">3.17</td>' in poles


@pytest.mark.parametrize(
    "change",
    [
        {"controller.control_period": 2e-3},
        {"gravity": 5.0},
        {"joints.friction.viscous": (5.0, 5.0, 5.0)},
        {"grips.model": "compliant"},
    ],
)
def test_the_modes_are_computed_anew_when_the_scenario_changes(change: dict):
    now = 0.0
    study, scenario = ModeStudy(lambda: now), load_preset("paper")
    study.ask(scenario)
    study.stop()
    before = study.result
    now = 0.1
    study.ask(scenario.replace(change))
    study.stop()
    assert study.problem == ""
    assert study.result is not before
    assert study.result is not None
    assert study.result.disk_margin is not None


AROUND_THE_BASES = {
    "trajectory.kind": "circle",
    "trajectory.center": (0.0, 0.0, 0.0),
    "trajectory.radius": 0.3,
    "trajectory.frequency": 0.2,
}
"""A path whose centre the arms cannot reach, so that there is no rest point for modes."""


def test_where_modes_cannot_be_computed_those_of_another_beam_are_not_shown(session: Session) -> None:
    lab_state = session.lab_state
    with RawBrowser(session) as browser:
        wait_until(lambda: any("45.54" in text.content for text in html_texts(session)), "the modes are shown")
        scenario = load_preset("paper").replace({**AROUND_THE_BASES, "payload.bending_stiffness": 10.0})
        lab_state.load(scenario, "around")
        why = "The left arm cannot reach the pose of the linearisation"
        wait_until(lambda: any(why in text.content for text in html_texts(session)), "the panel says why not")
        shown = [text.content for text in html_texts(session)]
        assert not [text for text in shown if "45.54</td>" in text or "Computing" in text]
        browser.update(widget(session, "Slow motion for it"), {"value": True})
        wait_until(lambda: lab_state.notice.text.startswith(why), "so does the button")


def test_while_a_slider_is_dragged_modes_are_computed_once_a_second():
    """Values come every 0.05 s and a computation takes 0.1 s; the last value is computed soon after the slider rests."""
    now, computed = 0.0, []

    def clock() -> float:
        nonlocal now
        if threading.current_thread().name == "flexlab-modes":  # A computation reads it at start and end.
            now += 0.1 * (len(computed) % 2)
            computed.append(now)
        return now

    study, scenario = ModeStudy(clock), load_preset("paper")
    for value in range(66):
        now = max(now, 0.05 * value)
        study.ask(scenario.replace({"payload.bending_stiffness": 100.0 + value}))
        study.stop()
    assert computed[::2] == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=0.21)
    before = study.result
    for value in (100.0, 100.0, 100.0, 100.0):
        study.ask(scenario.replace({"payload.bending_stiffness": value}))
        study.stop()
        now += 0.11
    assert study.result is not before
    assert study.background(scenario) is not None


def test_the_switch_of_the_animation_is_off_after_another_preset_is_opened(session: Session) -> None:
    lab_state, switch = session.lab_state, widget(session, "Animate its shape")
    with RawBrowser(session) as browser:
        browser.update(switch, {"value": True})
        wait_until(lambda: lab_state.view.shown_mode == 0, "the mode is animated")
        lab_state.submit(Reset())
        wait_until(lambda: session.runner.snapshot.run_number == 2, "a new run")
        assert lab_state.view.shown_mode == 0
        lab_state.load(load_preset("gravity"), "gravity")
        wait_until(lambda: not switch.value, "the switch is off")
        assert lab_state.view.shown_mode is None


def test_a_mode_that_a_coarser_mesh_lacks_is_said_to_be_missing(session: Session) -> None:
    lab_state = session.lab_state
    with RawBrowser(session) as browser:
        browser.update(widget(session, "Mode"), {"value": "4"})
        browser.update(widget(session, "Animate its shape"), {"value": True})
        wait_until(lambda: lab_state.view.shown_mode == 3, "the mode is animated")
        lab_state.change({"payload.element_count": 1})
        said = "Mode 4 needs a finer mesh: this one has 2 modes. Give it more elements."
        wait_until(lambda: any(said in text.content for text in html_texts(session)), "the panel says why it stands")
