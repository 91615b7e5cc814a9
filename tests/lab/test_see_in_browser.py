"""What a person sees: exaggeration, strain, forces, camera, modes and plots, in a real browser."""

import io
import math
from collections.abc import Sequence

import numpy as np
import pytest
from lab_page import SAME_PLACE, LabPage, wait_until
from PIL import Image
from playwright.sync_api import FloatRect, Locator

from flexlab.lab.scene.arms import ARM_COLORS
from flexlab.lab.scene.beam import BEAM_COLOR
from flexlab.lab.view_settings import PLOT_WINDOWS

NEAR, STRONG = 20, 100
"""Distance around a place, px, within which its colour is looked for; saturation, 0..255, from which a pixel has a colour."""
MANY = 10
"""Number of pixels of a colour that is more than chance."""
FACTOR = "Exaggeration of the deflection (×)"


def node_shown(page: LabPage, name: str) -> bool:
    return page.page.evaluate(f"window.__viserMutable.nodeRefFromName['{name}']?.visible ?? false")


def pixels_of(page: LabPage, place: Sequence[float], color: tuple[int, int, int]) -> int:
    """How many pixels around a place on the page have a colour's hue."""
    hue = np.asarray(Image.new("RGB", (1, 1), color).convert("HSV"), int)[0, 0, 0]
    away = np.abs((hues(page, *place) - hue + 128) % 256 - 128)
    return int(np.count_nonzero(away < 8))


def hues(page: LabPage, x: float, y: float) -> np.ndarray:
    """Hues of strong colours around a place on the page, px; (N,), 0..255 for the whole circle."""
    around = FloatRect(x=x - NEAR, y=y - NEAR, width=2 * NEAR, height=2 * NEAR)
    image = Image.open(io.BytesIO(page.page.screenshot(clip=around)))
    hue, saturation, _ = np.moveaxis(np.asarray(image.convert("HSV"), int), -1, 0)
    return hue[saturation > STRONG]


ROOM = """() => Object.values(window.__viserTestpoints.uplots).map(({ chart }) => chart)
  .filter((chart) => chart.root.offsetParent !== null)
  .flatMap((chart) => [...chart.root.querySelectorAll('.u-series:not(:first-child):not(.fl-unnamed) .u-value')].map((part) => {
    const { min, max } = chart.scales.y, shown = part.textContent;
    const widths = [min, max, min / 7, max / 7, 0].map((value) => {
      part.textContent = chart.series[1].value(chart, value);
      return Math.round(10 * part.getBoundingClientRect().width);
    });
    part.textContent = shown;
    return widths;
  })).filter((widths) => new Set(widths).size > 1)"""
"""The widths, 0.1 px, of legends' values that differ in width from one value of their axis to another."""

MARKS = """() => Object.values(window.__viserTestpoints.uplots).map(({ chart }) => chart)
  .filter((chart) => chart.scales.y.distr === 3)
  .flatMap(({ root, series }) =>
    [series[2].dash ?? [], getComputedStyle(root.querySelector('.fl-mark .u-marker')).borderTopStyle])"""
"""The dashes of the spectrum's marks, and the style of their piece in the legend."""


def is_legible(legend: list[str]) -> bool:
    return any(text[-1:].isdigit() for text in legend) and {"NaN", "-0", "−0", "--"}.isdisjoint(legend)


def test_arms_and_beam_are_drawn_in_their_colours_at_their_places(page: LabPage) -> None:
    first = page.camera()
    page.open_tab("View")
    page.press("Overview")  # The bases lie outside the first view.
    wait_until(lambda: math.dist(first, page.camera()) > 0.05, "the whole machine is in the picture")
    page.hold()
    page.catch_up()
    with page.drawn():
        for arm, color in zip(page.snapshot.scenario.arms, ARM_COLORS, strict=True):
            assert pixels_of(page, page.pixel(*arm.base, 0.0), color) > MANY
    whole = page.camera()
    page.press("Payload")  # Clear of the panels and plots that lie over the picture.
    wait_until(lambda: math.dist(whole, page.camera()) > 0.05, "the payload fills the picture")
    page.catch_up()
    with page.drawn():
        assert pixels_of(page, page.beam_pixel(), BEAM_COLOR) > MANY


def test_exaggeration_scales_the_drawing_and_nothing_else(page: LabPage) -> None:
    page.hold()
    run = page.snapshot.run_number
    page.open_tab("View")
    bends = {}
    for factor in (0, 1000):
        page.enter(FACTOR, str(factor))
        page.wait_for_text(f"{factor} × true size")
        wait_until(lambda factor=factor: page.session.lab_state.view.exaggeration == factor, "the factor is taken")
        page.catch_up()
        bends[factor] = page.beam_vertex()
    true = abs(float(page.snapshot.display.midspan_deflection[0]))
    assert math.dist(bends[0][:2], bends[1000][:2]) == pytest.approx(1000 * true, rel=0.02, abs=1e-4)
    assert page.snapshot.run_number == run


def test_the_unseen_parts_for_grabbing_hide_nothing_behind_them(page: LabPage) -> None:
    """The unseen tube around the beam used to leave a band in the floor, white or in the dark black, without grid and path."""
    ask = """() => ['/grab', '/arms/grab'].map((name) => {
      const kept = [];
      window.__viserMutable.nodeRefFromName[name].traverse(({ material }) => {
        if (material?.opacity === 0) kept.push(material.depthWrite); });
      return kept; })"""
    wait_until(lambda: page.page.evaluate(ask) == [[False], [False]], "neither keeps its depth")


def test_switches_of_the_view_show_their_parts_and_scales(page: LabPage) -> None:
    page.open_tab("View")
    for label, node, words in (
        ("Strain colours", "/strain", "strain, 1 mm off the axis"),
        ("Moving force", "/forces/moving", "scale of the moving force"),
        ("Internal moment", "/forces/moment", "scale of the internal moment"),
        ("Trail of the payload", "/overlays/trail", ""),
        ("Reach and singular poses", "/reach", ""),
    ):
        page.switch(label)
        wait_until(lambda node=node: node_shown(page, node), f"{node} is drawn")
        if words:
            page.wait_for_text(words)
    assert not node_shown(page, "/beam"), "the tube gives way to the strain colours"
    page.picture("everything")
    page.switch("Strain colours")
    wait_until(lambda: node_shown(page, "/beam"), "the tube is back")
    assert not page.errors


def test_the_camera_takes_each_view_and_follows_the_payload(page: LabPage) -> None:
    page.open_tab("View")
    seen = {}
    for view in ("Plan", "Front", "Left grip", "Overview"):
        before = page.camera()
        page.press(view)
        wait_until(lambda before=before: math.dist(before, page.camera()) > 0.05, f"the camera goes to {view}")
        page.catch_up()
        if view == "Overview":
            page.wait_for_camera()
        seen[view] = page.camera()
    assert abs(seen["Plan"][1] - seen["Overview"][1]) > 0.3
    assert seen["Front"][2] < seen["Overview"][2] < seen["Plan"][2]
    page.press("Follow")
    first = page.camera()
    wait_until(lambda: math.dist(first, page.camera()) > 0.05, "the camera follows the payload")
    page.press("Overview")
    wait_until(lambda: math.dist(seen["Overview"], page.camera()) < SAME_PLACE, "the camera is where it was")


def test_the_camera_shows_where_a_new_runs_path_goes(page: LabPage) -> None:
    page.wait_for_camera()
    first = page.camera()
    page.choose("Preset", "spin-up")
    wait_until(lambda: math.dist(first, page.camera()) > 0.05, "the camera shows the circle of the spin")
    page.catch_up()
    page.wait_for_camera()
    there = page.camera()
    page.key("r")
    page.catch_up()
    assert math.dist(there, page.camera()) < SAME_PLACE, "a reset leaves the path where it was"


def test_a_mode_is_listed_started_and_animated(page: LabPage) -> None:
    page.open_tab("Modes")
    page.wait_for_text("44.60")
    page.wait_for_text("sideways, 81 %")
    page.wait_for_text("Poles of the continuous loop")
    page.choose("Mode", "2")
    run = page.snapshot.run_number
    page.press("Start in it")
    wait_until(lambda: page.snapshot.run_number > run, "a new run")
    assert page.snapshot.target_speed == 1 / 128, "197 Hz is seen at 1.5 Hz"
    assert page.snapshot.scenario.initial.beam_coordinates is not None
    samples = page.session.runner.recent(0.05)
    assert np.abs(samples.midspan_deflection).max() < 2e-4, "mode 2 has a node at mid-span"
    assert np.abs(samples.beam_coordinates[0]).max() > 1e-3
    wait_until(lambda: page.session.lab_state.view.plot_window in PLOT_WINDOWS[:3], "the plots show a few waves")
    page.switch("Animate its shape")
    wait_until(lambda: page.session.lab_state.view.shown_mode == 1, "the mode is animated")
    page.picture("mode-2")
    page.switch("Animate its shape")
    wait_until(lambda: page.session.lab_state.view.shown_mode is None, "the run is drawn again")


def test_slow_motion_for_a_mode_needs_no_restart(page: LabPage) -> None:
    run = page.snapshot.run_number
    page.key("r")
    wait_until(lambda: page.snapshot.run_number == run + 1, "a new run, ringing")
    page.open_tab("Modes")
    page.wait_for_text("44.60")
    page.choose("Mode", "1")
    page.press("Slow motion for it")
    wait_until(lambda: page.snapshot.target_speed == 1 / 32, "44.6 Hz is seen at 1.4 Hz")
    assert page.snapshot.run_number == run + 1


def test_the_plots_of_every_tab_have_their_curves_and_legible_numbers(page: LabPage) -> None:
    # There is enough of the run to explain, below the charts, which stay where they are.
    page.wait_for_text("What the plots show")
    page.wait_for_text("Tracking error. The error of 0.71 mm is the beam's reaction divided by the feedback")
    for tab, texts in {
        "Torques": ("Joint torques, left arm", "Joint torques, right arm", "τ₁ (N·m)"),
        "Control": ("Sliding variable s", "boundary layer ε (m/s)", "b̂₂ (N·s²/m²)"),
        "Energy": ("kinetic (J)", "elastic (mJ)", "V (mJ)"),
        "Spectrum": ("f (Hz)", "vibration (µm)", "modes of the beam"),
        "Motion": ("Tracking error", "quasi-static (mm)", "M (N·m)"),
    }.items():
        page.open_tab(tab)
        for text in texts:
            page.wait_for_text(text)
        told = page.page.locator(".u-value:visible")
        if tab == "Spectrum":
            wait_until(lambda told=told: set(told.all_inner_texts()) == {"–"}, "a spectrum has no newest values")

        def legible(told: Locator = told, moves: bool = tab == "Spectrum") -> bool:
            for place in (20, 30) if moves else ():  # A chart that is drawn anew takes its values at the next movement.
                page.page.locator(".u-over:visible").hover(position={"x": place, "y": place})
            return is_legible(told.all_inner_texts())

        wait_until(legible, "the legend has numbers or –")
        page.picture(f"plots-{tab.lower()}")
    values = """() => Object.values(window.__viserTestpoints.uplots)
        .map(({ chart }) => [chart, Math.max(-chart.scales.y.min, chart.scales.y.max)])
        .map(([chart, end]) => chart.series[1].value(chart, 0.0012 * end))"""
    assert "0" not in page.page.evaluate(values), "a thousandth of the axis is no zero"
    assert page.page.evaluate(ROOM) == [], "a changing number does not move the names"
    assert page.page.evaluate(MARKS) == [[], "solid"], "marks drawn up and down have no dashes, in chart and legend"
    page.open_tab("View")
    page.choose("Plot window", "1 s")
    span = "() => { const u = Object.values(window.__viserTestpoints.uplots)[0].chart.scales.x; return u.max - u.min; }"
    wait_until(lambda: abs(page.page.evaluate(span) - 1.0) < 0.1, "the plots show one second")
    page.switch("Hold the plots still")
    wait_until(lambda: page.session.lab_state.view.hold_plots, "the plots are held")
    page.catch_up()
    newest = "() => Object.values(window.__viserTestpoints.uplots)[0].chart.data[0].at(-1)"
    held, then = page.page.evaluate(newest), float(page.snapshot.latest.time[0])
    wait_until(lambda: float(page.snapshot.latest.time[0]) > then + 0.3, "time goes on")
    page.catch_up()
    assert page.page.evaluate(newest) == held
    assert not page.errors
