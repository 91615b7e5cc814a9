"""Nothing that a browser can send stops the lab, reaches the engine or stays on the screen as if it were true."""

import dataclasses
import math
import time
from typing import Any

import pytest
from lab_page import wait_until
from raw_browser import RawBrowser, html_texts, widget

from flexlab.lab.session import RenderLoop, Session
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import Play

EI = "Bending stiffness EI (N·m²)"
K_SLIDER = "Feedback gain K, slider"
SETTLED = 8.0
"""Wall seconds within which a box shows the true value again."""


@pytest.fixture
def session(lasting_session: Session) -> Session:
    """One lab for all tests of this file."""
    return lasting_session


def shown_notice(session: Session) -> str:
    return session.lab_state.notice.text


def shows(session: Session, text: str) -> bool:
    """Whether the panel shows a text, whether or not its lines may break at each space."""
    breaks = str.maketrans("\N{NO-BREAK SPACE}", " ")
    found = text.translate(breaks)
    return any(html.visible and found in html.content.translate(breaks) for html in html_texts(session))


def still_works(session: Session, browser: RawBrowser) -> None:
    """Check that the lab still takes a good value and that time goes on."""
    before = float(session.runner.snapshot.latest.time[0])
    target = session.runner.snapshot.scenario.payload.bending_stiffness * 0.9
    browser.update(widget(session, EI), {"value": target})
    wait_until(
        lambda: session.runner.snapshot.scenario.payload.bending_stiffness == target, "a good value is taken", 20
    )
    wait_until(lambda: float(session.runner.snapshot.latest.time[0]) > before, "time goes on", 20)


@pytest.mark.parametrize(
    ("label", "updates", "said"),
    [
        (EI, {"value": math.nan}, "needs a finite number"),
        (EI, {"value": math.inf}, "needs a finite number"),
        (EI, {"value": "stiff"}, "needs a finite number"),
        (EI, {"value": True}, "needs a finite number"),
        (EI, {"value": None}, "needs a finite number"),
        (EI, {"value": [1, 2]}, "needs a finite number"),
        (EI, {"value": "9" * 1_000_000}, "needs a finite number"),
        (EI, {"removed": True}, "not a value"),
        (EI, {"update_cb": []}, "not a value"),
        (EI, {"value": 50.0, "gui_api": 1}, "not a value"),
        (EI, {}, "not a value"),
        ("Preset", {"value": "no-such-preset"}, "not one of its options"),
        ("Preset", {"value": "a" * 1_000_000}, "too long"),
        ("Preset", {"value": 7}, "needs a text"),
        ("Speed", {"value": "1e9"}, "not one of its options"),
        ("Desired pose", {"value": "yes"}, "on or off"),
        ("Reset", {"value": {"a": 1}}, "on or off"),
        ("Link masses m (kg)", {"value": [1.0, math.nan, 1.0]}, "needs a finite number"),
        ("Link masses m (kg)", {"value": [1.0, 2.0]}, "needs 3 numbers"),
        ("Link masses m (kg)", {"value": 5.0}, "needs 3 numbers"),
        ("Limited torques", {"value": 1}, "on or off"),
    ],
)
def test_an_invalid_value_is_refused(session: Session, label: str, updates: dict[str, Any], said: str) -> None:
    handle = widget(session, label)
    truth, scenario, run = handle.value, session.runner.snapshot.scenario, session.runner.snapshot.run_number
    with RawBrowser(session) as browser:
        browser.update(handle, updates)
        wait_until(lambda: said in shown_notice(session), f"the screen says {said!r}", 20)
        assert len(shown_notice(session)) < 400
        assert handle.value == truth
        assert session.runner.snapshot.scenario == scenario
        assert session.runner.snapshot.run_number == run
        still_works(session, browser)


@pytest.mark.usefixtures("soon_put_right")
@pytest.mark.parametrize(
    ("label", "value", "path"),
    [
        (EI, 1e14, "Bending stiffness EI ="),
        (EI, -1.0, "Bending stiffness EI ="),
        (K_SLIDER, 1e9, "Feedback gain K ="),
        (K_SLIDER, -1.0, "Feedback gain K ="),
        ("Bending stiffness EI, slider", 1e9, "Bending stiffness EI ="),
        ("Elements n", 2.5, "Elements n ="),
        ("Elements n", 1e9, "Elements n ="),
        ("Seed", 2.5, "Seed ="),
        ("Input delay d (samples)", 3, "controller"),
        ("Believed L / true L", 0.0, "Believed L / true L ="),
        ("Link lengths l (m)", [0.7, -0.6, 0.2], "Link lengths l, 2 of 3 = −0.6\N{NO-BREAK SPACE}m"),
        ("Exaggeration of the deflection (×)", 1e9, None),
    ],
)
def test_a_number_out_of_range_is_refused_and_its_box_corrected(
    session: Session, label: str, value: Any, path: str | None
) -> None:
    handle, scenario, view = widget(session, label), session.runner.snapshot.scenario, session.lab_state.view
    truth = handle.value
    with RawBrowser(session) as browser:
        browser.update(handle, {"value": value})
        if path:
            wait_until(lambda: shows(session, path), "a sentence", 20)
        else:
            wait_until(lambda: handle.value == value, "the server has seen the value", 20)
        time.sleep(0.2)
        assert session.runner.snapshot.scenario == scenario
        # The exaggeration follows the deflection as long as nobody chose one.
        now = session.lab_state.view
        assert dataclasses.replace(now, exaggeration=view.exaggeration) == view
        assert now.exaggeration < 1e6
        wait_until(
            lambda: handle.value == pytest.approx(truth if path else session.lab_state.view.exaggeration, rel=1e-3),
            "the widget shows the truth again",
            SETTLED,
        )
        still_works(session, browser)


@pytest.mark.usefixtures("soon_put_right")
@pytest.mark.parametrize("late", [0.0, 2.5])
def test_a_number_typed_while_a_refused_one_is_corrected_is_shown(session: Session, late: float) -> None:
    box = widget(session, EI)
    truth, typed, shown = box.value, 0.8 * box.value, []
    with RawBrowser(session) as browser:
        browser.update(box, {"value": -3.0})
        wait_until(lambda: box.value == -3.0, "the lab has heard it", 20)
        wait_until(lambda: box.value == truth, "the box is put right", 20)
        time.sleep(late)  # On a busy machine the page learns of the correction late.
        browser.update(box, {"value": typed})
        until = time.monotonic() + 20
        while shown[-1:] != [typed]:
            assert time.monotonic() < until, f"the page shows {shown[-1:]}"
            shown += browser.values_of(box)
    assert truth in shown


def test_the_first_update_of_the_panel_keeps_a_complaint_on_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """A page can be quicker than the panel's first update, which used to remove every sentence."""
    begin = RenderLoop.start
    held: list[RenderLoop] = []
    monkeypatch.setattr(RenderLoop, "start", lambda drawing: held.append(drawing))
    with Session(load_preset("paper"), "paper", shadows=False) as session, RawBrowser(session) as browser:

        def said() -> bool:
            return shows(session, "Link lengths l, 2 of 3")

        browser.update(widget(session, "Link lengths l (m)"), {"value": [0.7, -0.6, 0.2]})
        wait_until(said, "a sentence", 20)
        begin(held[0])
        wait_until(lambda: any("mid-span deflection" in html.content for html in html_texts(session)), "an update", 20)
        time.sleep(0.3)
        assert said()


@pytest.mark.parametrize(
    ("label", "value", "path"),
    [
        (EI, -1.0, "Bending stiffness EI ="),
        ("Link lengths l (m)", [0.7, -0.6, 0.2], "Link lengths l, 2 of 3 = −0.6\N{NO-BREAK SPACE}m"),
    ],
)
def test_a_complaint_stays_in_a_new_run_as_long_as_it_is_true(
    session: Session, label: str, value: Any, path: str
) -> None:
    """The panel may first look at a new run after a person has typed: that look used to remove the sentence."""

    def said() -> bool:
        return shows(session, path)

    def begin_run(scenario: Scenario) -> None:
        before = session.runner.snapshot.run_number
        session.lab_state.load(scenario, "paper")
        wait_until(lambda: session.runner.snapshot.run_number > before, "a new run", 20)
        wait_until(lambda: panel._run_number > before, "the panel looks at it", 20)
        status = panel._status.content
        wait_until(lambda: panel._status.content != status, "and has done so", 20)

    panel: Any = session._panel
    paper = load_preset("paper")
    with RawBrowser(session) as browser:
        begin_run(paper)
        browser.update(widget(session, label), {"value": value})
        wait_until(said, "a sentence", 20)
        begin_run(paper)
        assert said()
        begin_run(paper.replace({"payload.bending_stiffness": 64.0, "left_arm.link_length": (0.7, 0.6, 0.3)}))
        wait_until(lambda: not said(), "the sentence goes, as it is no longer true", 20)


def test_junk_on_the_wire_costs_only_its_own_connection(session: Session) -> None:
    for junk in (b"", b"\xff" * 100, b"\x81\xa4type\xa5Wrong"):
        with RawBrowser(session) as browser:
            browser.send_bytes(junk)
    with RawBrowser(session) as browser:
        browser.send({"type": "GuiUpdateMessage", "uuid": "nobody", "updates": {"value": 1}})
        still_works(session, browser)


def test_the_share_tunnel_cannot_be_opened(session: Session) -> None:
    with RawBrowser(session) as browser:
        browser.send({"type": "ShareUrlRequest"})
        still_works(session, browser)
        assert session.server._share_tunnel is None
        assert session.server.request_share_url() is None


@pytest.mark.parametrize(("goal", "said"), [(1e308, "go there in steps"), (-1e308, "has passed")])
def test_a_time_that_no_run_can_reach_is_answered_in_a_sentence(
    session: Session, caplog: pytest.LogCaptureFixture, goal: float, said: str
) -> None:
    box = widget(session, "Run to t (s)")
    truth = box.value
    with RawBrowser(session) as browser:
        browser.update(box, {"value": goal})
        browser.update(widget(session, "Run to it"), {"value": True})
        wait_until(lambda: shown_notice(session), "a sentence", 20)
        assert said in shown_notice(session)
        browser.update(box, {"value": truth})
        still_works(session, browser)
    assert not [record for record in caplog.records if record.exc_info]


@pytest.mark.parametrize("button", ["Step", "Run to it"])
def test_a_stopped_run_answers_that_it_takes_no_step(session: Session, button: str) -> None:
    lab_state, paper = session.lab_state, load_preset("paper")
    far = paper.replace({"trajectory.amplitude": (5.0, 0.0, 0.0)})
    with RawBrowser(session) as browser:
        lab_state.load(far, "far")
        wait_until(lambda: session.runner.snapshot.status.failed, "it cannot be reached", 20)
        browser.update(widget(session, button), {"value": True})
        wait_until(lambda: "This run has stopped: " in shown_notice(session), "a sentence", 20)
        lab_state.load(paper, "paper")
        wait_until(lambda: not session.runner.snapshot.status.failed, "it can run", 20)
        lab_state.submit(Play())
        wait_until(lambda: float(session.runner.snapshot.latest.time[0]) > 0, "time goes on", 20)


def test_html_in_the_texts_of_a_scenario_is_escaped(session: Session) -> None:
    from flexlab.sim.commands import LoadScenario

    bad = session.runner.snapshot.scenario.model_copy(
        update={"title": "<script>alert(1)</script>", "watch": "<b>x</b>"}
    )
    with RawBrowser(session):
        session.runner.submit(LoadScenario(bad, "<i>name</i>"))
        wait_until(lambda: session.runner.snapshot.name == "<i>name</i>", "it runs", 20)
        wait_until(lambda: any("&lt;script" in html.content for html in html_texts(session)), "it is shown escaped", 20)
        for html in html_texts(session):
            assert "<script" not in html.content
            assert "<i>name" not in html.content


def test_a_field_has_no_usual_value_from_a_path_or_law_in_which_it_is_another_number(session: Session) -> None:
    """The paper's sine has three phases. Beside the phase of a circle just chosen, the button offered the first of them."""

    def way_back(title: str) -> Any:
        named = f"{title}: back to its usual value"
        handles = list(session.server.gui._gui_input_handle_from_uuid.values())
        return next((each for each in handles if getattr(each._impl.props, "hint", None) == named), None)

    with RawBrowser(session) as browser:
        browser.receive(20)
        session.lab_state.change({"trajectory.kind": "circle"})
        wait_until(lambda: way_back("Radius R") and way_back("Phase φ_d"), "the circle's controls are there", 20)
        assert not way_back("Phase φ_d").visible
        session.lab_state.change({"trajectory.radius": 0.11})
        wait_until(lambda: session.lab_state.intended.get("trajectory.radius") == 0.11, "it is asked for", 20)
        time.sleep(0.5)
        assert not way_back("Phase φ_d").visible
        session.lab_state.change({"trajectory.kind": "sine"})
