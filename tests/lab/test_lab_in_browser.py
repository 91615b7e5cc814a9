"""What a person does first in the lab, in a real browser, and what the simulation then does."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from lab_page import EI, LabPage, wait_until
from playwright.sync_api import expect
from raw_browser import widget
from viser._messages import GuiUpdateMessage

from flexlab.lab.lab_state import LabState
from flexlab.presets import load_preset
from flexlab.views import fitting_exaggeration

SHOWN = "Object.values(window.__viserTestpoints.uplots).filter(({ chart }) => chart.root.offsetParent !== null)"
"""The charts of the open tab: an earlier test may have opened another one."""
SINGLE = 2.0**-23
"""Relative precision of the numbers in plots."""


def test_the_drawn_beam_follows_the_simulation(page: LabPage) -> None:
    first = page.beam_vertex()
    wait_until(lambda: math.dist(first, page.beam_vertex()) > 0.05, "the beam has moved 5 cm")
    page.hold()
    x, y, _ = page.snapshot.display.pose[0]

    def stands_there() -> bool:
        drawn = page.beam_vertex()
        return math.dist((x, y), drawn[:2]) < 0.05

    wait_until(stands_there, "the beam stands where the simulation holds it")
    assert not page.errors


def test_changing_the_stiffness_changes_f1_and_keeps_the_motion_continuous(page: LabPage) -> None:
    page.wait_for_text("44.60 Hz")
    before = page.snapshot
    page.enter(EI, "25")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 25.0, "the simulation has EI = 25")
    page.wait_for_text("22.30 Hz")
    assert page.snapshot.first_frequency == pytest.approx(before.first_frequency / 2, rel=1e-9)
    assert page.snapshot.run_number == before.run_number
    samples = page.session.runner.recent(30)
    assert np.abs(np.diff(samples.pose, axis=0)).max() < 3e-3
    page.open_tab("Events")
    page.wait_for_text("25 N·m²")


@pytest.mark.usefixtures("still")
def test_the_slider_of_the_stiffness_is_logarithmic_and_reaches_both_ends_of_its_range(page: LabPage) -> None:
    slider = page.page.get_by_role("slider", name="Bending stiffness EI", exact=True)
    slider.focus()
    slider.press("End")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 1000.0, "EI is at its slider's end")
    wait_until(lambda: page.box(EI).input_value() == "1000", "the box shows the slider's value")
    slider.press("Home")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 1.0, "EI is at its slider's start")
    slider.press("ArrowRight")  # One of 200 steps over three decades.
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 1.035, "each step multiplies EI")


@pytest.mark.usefixtures("still")
def test_a_box_sets_all_three_numbers_of_a_field_or_only_its_own(page: LabPage) -> None:
    for label, typed, field, wanted in (
        ("Feedback gain K (N·s/m, N·m·s/rad)", "300", "controller.feedback_gain", 300.0),
        ("Adaptation k₁ (m³/N)", "25", "controller.adaptation", (10.0, 25.0, 10.0)),
        ("Amplitude θ (rad)", "0.1", "trajectory.amplitude", (0.2, 0.2, 0.1)),
        ("Frequency f_d (Hz)", "0.5", "trajectory.frequency", (0.5, 0.5, 0.5)),
    ):
        page.enter(label, typed)
        wait_until(
            lambda field=field, wanted=wanted: page.snapshot.scenario.get(field) == wanted, f"{field} is taken up"
        )


def test_another_preset_starts_a_new_run_and_the_page_shows_it(page: LabPage) -> None:
    run = page.snapshot.run_number
    page.press("Pause")  # In a run that goes on, a large deflection lowers the exaggeration.
    wait_until(lambda: not page.snapshot.playing, "the run stands")
    page.choose("Preset", "soft-beam")
    wait_until(lambda: page.snapshot.run_number > run, "a new run")
    assert page.snapshot.scenario == load_preset("soft-beam")
    assert page.snapshot.name == "soft-beam"
    page.wait_for_text(load_preset("soft-beam").title)
    wait_until(lambda: page.box(EI).input_value() == "1.27", "the EI box shows the preset's value")
    page.wait_for_text(f"{fitting_exaggeration(load_preset('soft-beam')):g} × true size")
    page.press("Play")
    wait_until(lambda: page.snapshot.playing, "the run goes on")


def test_one_arm_can_be_shown(page: LabPage) -> None:
    page.choose("Preset", "single-arm")
    wait_until(lambda: page.snapshot.name == "single-arm", "the single arm runs")
    first = page.beam_vertex()
    wait_until(lambda: math.dist(first, page.beam_vertex()) > 0.02, "its beam moves")
    page.picture("single-arm")
    page.choose("Preset", "paper")
    wait_until(lambda: page.snapshot.name == "paper", "two arms again")
    assert not page.errors


def test_pause_step_and_reset(page: LabPage) -> None:
    page.hold()
    page.wait_for_text("Paused")
    held = float(page.snapshot.latest.time[0])
    page.press("Step")
    wait_until(lambda: float(page.snapshot.latest.time[0]) == pytest.approx(held + 0.001, abs=1e-9), "one step further")
    page.enter(EI, "50")
    page.press("Reset")
    wait_until(lambda: float(page.snapshot.latest.time[0]) < held, "time starts again")
    page.press("Play")
    wait_until(lambda: page.snapshot.playing, "the simulation goes on")
    assert page.snapshot.scenario.payload.bending_stiffness == 50.0


def test_slow_motion_does_not_restart_the_run(page: LabPage) -> None:
    run = page.snapshot.run_number
    page.choose("Speed", "1/64 ×")
    wait_until(lambda: page.snapshot.target_speed == 1 / 64, "the speed is taken up")
    page.wait_for_text("1/64 × / 0.01")
    assert page.snapshot.run_number == run


@pytest.mark.usefixtures("soon_put_right", "still")
def test_a_bad_number_is_answered_in_a_sentence_and_changes_nothing(page: LabPage) -> None:
    for typed, true, good in (("-1", "100", "64"), ("1000000000000000", "64", "36")):
        page.enter(EI, typed)
        page.wait_for_text(f"It stays at {true} N·m².")
        page.wait_for_text("Bending stiffness EI = ")
        assert "outside the allowed range" in page.text()
        assert page.snapshot.scenario.payload.bending_stiffness == float(true)
        wait_until(lambda true=true: page.box(EI).input_value() == true, "the box shows the true value again", 30)
        page.enter(EI, good)
        wait_until(
            lambda good=good: page.snapshot.scenario.payload.bending_stiffness == float(good),
            "the lab still takes good values",
        )


@pytest.mark.usefixtures("still")
def test_a_box_takes_numbers_as_people_write_them(page: LabPage) -> None:
    box = page.box(EI)
    for typed, taken in (("1.5e2", 150.0), ("64", 64.0), ("2,5E+1", 25.0), ("9e-1", 0.9), ("90", 90.0)):
        box.press("ControlOrMeta+a")
        box.press_sequentially(typed)
        wait_until(
            lambda taken=taken: page.snapshot.scenario.payload.bending_stiffness == taken, f"{typed} is {taken:g}"
        )
        assert float(box.input_value()) == taken
    box.press("ControlOrMeta+a")
    box.press_sequentially("−3")
    page.wait_for_text("Bending stiffness EI = −3 N·m² is outside the allowed range 0.001 to 10¹² N·m²")
    page.enter(EI, "36")
    page.enter("Damping c (N·s/m)", "0.00000000015")
    wait_until(lambda: page.snapshot.scenario.payload.damping.coefficient == 1.5e-10, "a small number is not 0", 20)
    box.fill("")
    box.blur()
    expect(box).to_have_value("36")  # Left empty, it shows its number again.


DROP = """(box, text) => {
    const dataTransfer = new DataTransfer();
    dataTransfer.setData("text/plain", text);
    box.dispatchEvent(new DragEvent("drop", { dataTransfer, bubbles: true, cancelable: true }));
}"""


@pytest.mark.usefixtures("still")
def test_a_pasted_or_dropped_text_is_a_number_or_is_refused(page: LabPage) -> None:
    """A pasted "5 kN" became 5, 0x10 became 10, and 1,234.5 did nothing."""
    page.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    box = page.box(EI)
    page.enter(EI, "36")
    for pasted in ("5 kN", "0x10", "1.5.2", "1,234.5", "five"):
        page.page.evaluate("(text) => navigator.clipboard.writeText(text)", pasted)
        box.press("ControlOrMeta+a")
        box.press("ControlOrMeta+v")
        page.wait_for_text(f"'{pasted}' is not a number: write one such as 0.5 or 1e3.")
        expect(box).to_have_value("36")
    for pasted, taken in ((" 7.5", 7.5), ("2,5", 2.5), ("1e2", 100.0), ("90\n", 90.0)):
        page.page.evaluate("(text) => navigator.clipboard.writeText(text)", pasted)
        box.press("ControlOrMeta+a")
        box.press("ControlOrMeta+v")
        wait_until(
            lambda taken=taken: page.snapshot.scenario.payload.bending_stiffness == taken, f"{pasted!r} is {taken:g}"
        )
    for dropped in ("5 kN", "45"):
        box.evaluate(DROP, dropped)
    page.wait_for_text("'5 kN' is not a number: write one such as 0.5 or 1e3.")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 45, "it takes the place of 90")


@pytest.mark.usefixtures("still")
def test_a_typed_number_may_be_much_longer_than_the_present_one(page: LabPage) -> None:
    page.enter(EI, "100")
    box = page.box(EI)
    for keys, value in (
        (("ControlOrMeta+a", *"30.25"), 30.25),
        (("ControlOrMeta+a", *"100", "Enter", *"500"), 100500.0),
        (("ControlOrMeta+a", *"2.5", "Enter", *"7777", "Backspace", "Backspace", "ArrowLeft", "1"), 2.5717),
    ):
        for key in keys:
            box.press(key)
        wait_until(lambda value=value: page.snapshot.scenario.payload.bending_stiffness == value, f"EI is {value}")
        expect(box).to_have_value(f"{value:g}" if value < 100 else f"{value:.0f}")


@pytest.mark.usefixtures("still")
@pytest.mark.parametrize("acts", [False, True])
def test_a_late_value_from_the_lab_does_not_disturb_typing(page: LabPage, acts: bool) -> None:
    """Neither before the typed digits take effect nor, if `acts`, after that."""
    page.enter(EI, "100")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 100.0, "EI is 100")
    box = page.box(EI)
    page.page.evaluate("window.usualTimeout = window.setTimeout")
    stretched = """(those) => window.setTimeout = (call, ms, ...more) =>
      usualTimeout(call, those.includes(ms) ? 1_000_000 : ms, ...more)"""
    page.page.evaluate(stretched, [3000] if acts else [400, 3000])
    box.press("ControlOrMeta+a")
    box.press_sequentially("2.")
    if acts:
        wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 2.0, "EI is 2")
    for late in (64.0, 100.0):
        show_true_value_of(page, late)
    assert box.input_value() == "2."
    page.page.evaluate(stretched, [3000])
    box.press_sequentially("5717")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 2.5717, "EI is 2.5717")
    expect(box).to_have_value("2.5717")
    page.page.evaluate("window.setTimeout = usualTimeout")
    box.blur()
    page.session.lab_state.change({"payload.bending_stiffness": 64.0})
    expect(box).to_have_value("64")  # Once typing has ended.


def show_true_value_of(page: LabPage, value: float) -> None:
    """Have the lab send the page a value of EI, and give it a second to arrive."""
    handle = widget(page.session, EI)
    message = GuiUpdateMessage(handle._impl.uuid, {"value": value})
    handle._impl.gui_api._websock_interface.queue_message(message)
    page.page.wait_for_timeout(1000)


@pytest.mark.usefixtures("still")
def test_a_typed_number_takes_effect_when_typing_pauses_or_ends(page: LabPage) -> None:
    page.enter(EI, "100")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 100.0, "EI is 100")
    taken: list[float] = []
    change = LabState.change

    def heard(lab_state: LabState, changes: Mapping[str, Any]) -> None:
        taken.extend(value for path, value in changes.items() if path == "payload.bending_stiffness")
        change(lab_state, changes)

    box = page.box(EI)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(LabState, "change", heard)
        for typed, key, value in (("600", "", 600.0), ("2,5", "", 2.5), ("70", "Enter", 70.0), ("80", "Tab", 80.0)):
            box.press("ControlOrMeta+a")
            box.press_sequentially(typed)
            if key:
                box.press(key)
            wait_until(lambda value=value: taken[-1:] == [value], f"{typed} {key} acts")
        box.press("ControlOrMeta+a")
        box.press_sequentially("90")
        box.press("ArrowUp")
        wait_until(lambda: taken[-1:] == [91.0], "an arrow adds to what was typed")
    assert [value for value in taken if value != 90.0] == [600.0, 2.5, 70.0, 80.0, 91.0]


def test_an_unreachable_path_is_explained_and_not_taken(page: LabPage) -> None:
    page.enter("Amplitude x (m)", "2")
    page.wait_for_text("cannot reach")
    assert page.snapshot.scenario == load_preset("paper")
    assert page.snapshot.playing
    page.choose("Preset", "smooth-start")
    wait_until(lambda: page.snapshot.name == "smooth-start" and page.snapshot.playing, "another preset runs")


def test_plots_follow_the_run_with_units_and_a_time_axis_of_fixed_length(page: LabPage) -> None:
    page.open_tab("Motion")  # Another file's tests may have left the window at other plots.
    run = page.snapshot.run_number
    page.press("Reset")
    wait_until(lambda: page.snapshot.run_number > run, "a new run")
    wait_until(lambda: float(page.snapshot.latest.time[0]) > 1.0, "a second of signals")
    ring = 1e3 * np.abs(page.session.runner.recent(30).vibration).max()
    for text in ("Tracking error", "x (mm)", "θ (mrad)", "vibration (mm)", "quasi-static (mm)", "Fx (N)", "M (N·m)"):
        assert text in page.text()
    ask = (
        f"() => {SHOWN}"
        + """.map((u) => ({
      made: u.createCount, span: u.chart.scales.x.max - u.chart.scales.x.min,
      low: u.chart.scales.y.min, high: u.chart.scales.y.max,
      peak: Math.max(...Array.from(u.chart.data[1]).filter(Number.isFinite).map(Math.abs)) }))"""
    )
    charts = page.page.evaluate(ask)
    assert len(charts) == 3
    assert charts[1]["peak"] == pytest.approx(ring, rel=SINGLE), "the start-up ring is in the plot in full height (mm)"
    for chart in charts:
        assert chart["low"] <= -0.1 * chart["high"] < 0
        assert chart["span"] == pytest.approx(5.0, rel=0.05)
        assert chart["made"] == charts[0]["made"]
    wait_until(lambda: float(page.snapshot.latest.time[0]) > 3.0, "more signals")
    assert [chart["made"] for chart in page.page.evaluate(ask)] == [chart["made"] for chart in charts]


def test_a_plot_zoomed_to_an_empty_part_keeps_its_vertical_axis(page: LabPage) -> None:
    page.open_tab("Motion")
    page.key("r")
    wait_until(lambda: 0.2 < float(page.snapshot.latest.time[0]) < 3.5, "the plots are half full")
    page.hold()
    page.catch_up()  # New samples would move the axes back.
    zoom = (
        f"async () => {{ const plots = {SHOWN}.map((u) => u.chart);"
        + """
      plots.forEach((plot) => plot.setScale('x', { min: 4.0, max: 4.9 }));
      await new Promise((done) => requestAnimationFrame(done));
      return plots.map((plot) => [plot.scales.x.min, plot.scales.y.min, plot.scales.y.max]); }"""
    )
    for left, low, high in page.page.evaluate(zoom):
        assert left == 4.0
        assert low < 0 < high


def test_the_numbers_at_the_axes_are_exact(page: LabPage) -> None:
    """With the three decimals of the chart itself, ticks 0.0025 apart would read 0.003, 0.005, 0.008."""
    page.hold()
    page.catch_up()
    ask = """async () => { const plots = Object.values(window.__viserTestpoints.uplots).map((u) => u.chart), found = [];
      for (const size of [10, 10.5, 11, 11.5, 12, 13, 14, 20, 50, 100, 20000]) {
        plots.forEach((plot) => plot.setScale("y", { min: -size / 1000, max: 0 }));
        await new Promise((done) => requestAnimationFrame(done));
        found.push(...plots.map(({ axes }) => [axes[1]._splits, axes[1]._values])); }
      return found; }"""
    for places, written in page.page.evaluate(ask):
        assert len(places) > 2
        assert "-" not in "".join(written), "a minus sign is no hyphen"
        assert [float(text.replace("\u2212", "-")) for text in written] == pytest.approx(places, abs=1e-9)


def test_a_law_that_takes_over_states_its_stability_conditions(page: LabPage) -> None:
    """The conditions and their numbers, shown below the gains, follow the law and its gains; the run goes on."""
    page.wait_for_text("‖Ψ‖ ≤ K ε")
    wait_until(lambda: float(page.snapshot.display.time[0]) > 0.2, "the paper's law has worked for a while")
    before = page.snapshot
    page.choose("Control law", "super-twisting")
    wait_until(lambda: page.snapshot.scenario.controller.kind == "super-twisting", "the law is at work")
    page.wait_for_text("met k₂ > δ: 200 N/s")
    assert float(page.snapshot.display.time[0]) >= float(before.display.time[0])
    page.enter("Switching gain k₂ (N/s, N·m/s)", "40")
    page.wait_for_text("not met k₂ > δ: 40 N/s")
    page.choose("Control law", "regressor-adaptive")
    page.wait_for_text("combinations of masses")
    page.choose("Control law", "none")
    wait_until(lambda: "λ < ω₁" not in page.text(), "motors that are off need nothing")
    assert float(page.snapshot.display.time[0]) > float(before.display.time[0])
    assert not page.errors
