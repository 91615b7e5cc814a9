"""Several browsers share a lab: when one of them opens another preset, the others are told."""

from lab_page import wait_until
from raw_browser import RawBrowser, widget

from flexlab.lab.session import Session
from flexlab.lab.viser_internals import widget_uuid
from flexlab.presets import load_preset

SAID = "Somebody in this lab opened"


def test_opening_another_preset_is_announced_only_if_others_share_the_lab(session: Session) -> None:
    lab_state = session.lab_state
    with RawBrowser(session) as browser:
        wait_until(lambda: lab_state.company() == 1, "one is there")
        browser.update(widget(session, "Preset"), {"value": "smooth-start"})
        wait_until(lambda: session.runner.snapshot.name == "smooth-start", "the preset is taken", 60)
        assert SAID not in lab_state.notice.text
        with RawBrowser(session):
            wait_until(lambda: lab_state.company() == 2, "two are there")
            browser.update(widget(session, "Preset"), {"value": "paper"})
            wait_until(lambda: SAID in lab_state.notice.text, "the other is told", 60)
            title = load_preset("paper").title
            assert lab_state.notice.text == f'{SAID} "{title}". Undo (Ctrl+Z) goes back.'
            browser.update(widget(session, "Undo"), {"value": True})
            title = load_preset("smooth-start").title
            told = f'{SAID} "{title}". Redo (Ctrl+Shift+Z) goes back.'
            wait_until(lambda: lab_state.notice.text == told, "the others hear how to go back", 60)
            browser.update(widget(session, "Redo"), {"value": True})
            wait_until(lambda: "Undo (Ctrl+Z) goes back" in lab_state.notice.text, "and again", 60)
    lab_state.undo()
    wait_until(lambda: session.runner.snapshot.name == "smooth-start", "what was open before is open again", 60)


def test_whoever_uses_a_control_is_sent_its_value_again_as_another_one_may_have_crossed_it(session: Session) -> None:
    wanted = {
        "Bending stiffness EI, slider": 2.2,
        "Bending stiffness EI (N·m²)": 158.5,
        "Limited torques": True,
        "Torque limit per joint τ_max (N·m)": [300.0, 300.0, 300.0],
        "Plot window": "2 s",
        "Name": "mine",
    }
    with RawBrowser(session) as browser, RawBrowser(session) as other:
        wait_until(lambda: session.lab_state.company() == 2, "two are there")
        controls = {label: widget(session, label) for label in wanted}
        for label, value in {**wanted, "Plot window": "10 s", "Name": "yours", "Limited torques": False}.items():
            other.update(controls[label], {"value": value})
        wait_until(lambda: controls["Name"].value == "yours", "the other's values are there")
        for label, value in wanted.items():
            browser.update(controls[label], {"value": value})
        wait_until(lambda: controls["Name"].value == "mine", "this one's values are there")
        missing = set(wanted)

        def told() -> bool:
            values = browser.receive_values()
            missing.difference_update([k for k in missing if values.get(widget_uuid(controls[k])) == wanted[k]])
            return not missing

        wait_until(told, "this one is sent the values that count", 30)
