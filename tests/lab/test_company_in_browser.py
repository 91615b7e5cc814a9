"""Several browsers on one lab, windows of every size, light and dark."""

from typing import Literal

import numpy as np
from lab_page import EI, GUIDE_OPEN, PLOTS_OPEN, LabPage, wait_until
from lasting_window import LastingWindow
from playwright.sync_api import Browser, Locator

from flexlab.lab.session import Session
from flexlab.presets import load_preset

OVERFLOWING = """() => {
  const width = window.innerWidth;
  return [...document.querySelectorAll('label, button, input, .fl, .uplot, p')]
    .filter((node) => node.offsetParent !== null && !node.closest('[hidden]'))
    .map((node) => [node, node.getBoundingClientRect()])
    .filter(([node, box]) => box.width > 0 && (box.left < -1 || box.right > width + 1))
    .map(([node, box]) => node.outerHTML.slice(0, 90) + ' ' + box.left + '..' + box.right); }"""

TABS = ("Parameters", "View", "Touch", "Modes", "Compare", "File", "Events")
SCHEME = "document.documentElement.dataset.mantineColorScheme"
WAY = "() => document.querySelector('.fl-reports')?.dataset.way"
"""The widget by which a page reports what it has drawn: each lab has another one."""
BACKGROUND, WHITE = "getComputedStyle(document.body).backgroundColor", "rgb(255, 255, 255)"


def test_a_lost_connection_comes_back_to_the_running_lab(page: LabPage) -> None:
    page.enter(EI, "20")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 20.0, "the change is taken")
    before = float(page.snapshot.latest.time[0])
    left = set(page.session.server.get_clients())
    page.session.server._websock_server.disconnect_all_clients()
    wait_until(lambda: len(set(page.session.server.get_clients()) - left) == 1, "the browser is back")
    page.catch_up()
    wait_until(lambda: page.box(EI).input_value() == "20", "it shows the value")
    wait_until(lambda: float(page.snapshot.latest.time[0]) > before, "nothing was lost meanwhile")
    page.enter(EI, "25")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 25.0, "it can be used as before")


def test_open_panels_are_open_again_after_the_lab_restarts(window: LastingWindow, page: LabPage) -> None:
    page.press("Pause")
    way = page.page.evaluate(WAY)
    page.session.stop()
    window.adopt(Session(load_preset("paper"), "paper", port=window.port, shadows=False))
    page.session.start()
    wait_until(lambda: page.page.evaluate(WAY) not in (None, way), "the page is in the new lab")
    for is_open in (PLOTS_OPEN, GUIDE_OPEN):
        page.page.wait_for_function(is_open)


def turn(page: LabPage, look: Literal["dark", "light"]) -> None:
    """Change the colour scheme that the system asks for, and wait until the page has it."""
    page.page.emulate_media(color_scheme=look)
    wait_until(lambda: page.page.evaluate(SCHEME) == look, f"the lab says that it is {look}")
    wait_until(lambda: (page.page.evaluate(BACKGROUND) == WHITE) == (look == "light"), f"it is {look}")


def all_is_on_the_screen(page: LabPage, name: str) -> None:
    """Check that every tab fits on the screen. `name`: of the screenshots."""
    for tab in TABS:
        page.open_tab(tab)
        wait_until(lambda: page.page.evaluate(OVERFLOWING) == [], f"all of {tab} is on the screen", 20)
        if tab in ("Parameters", "Modes", "File"):
            page.picture(f"{tab.lower()}-{name}")
    heights = [page.page.get_by_role("tab", name=tab, exact=True).bounding_box() for tab in TABS]
    assert len({box and box["y"] for box in heights}) == 1, f"all tabs stand on one line: {heights}"
    assert not page.errors


def test_nothing_is_clipped_in_a_window_that_shrinks(page: LabPage) -> None:
    page.wait_for_text("simulation time t")
    page.press("Pause")
    turn(page, "dark")
    all_is_on_the_screen(page, "1440x900-dark")
    page.page.set_viewport_size({"width": 1024, "height": 768})
    turn(page, "light")
    all_is_on_the_screen(page, "1024x768-light")
    page.page.set_viewport_size({"width": 1440, "height": 900})


def is_above(upper: Locator, lower: Locator) -> bool:
    """Whether `upper` begins higher on the page than `lower`; false while either is hidden."""
    boxes = upper.bounding_box(), lower.bounding_box()
    return boxes[0] is not None and boxes[1] is not None and boxes[0]["y"] < boxes[1]["y"]


def test_a_phone_that_starts_in_dark_mode_stays_in_step_and_clips_nothing(chromium: Browser, page: LabPage) -> None:
    """A late browser sees the running state, and both draw the same."""
    page.enter(EI, "20")
    wait_until(lambda: page.snapshot.scenario.payload.bending_stiffness == 20.0, "the change is taken")
    with LabPage(chromium, page.session, (390, 844), color_scheme="dark") as phone:
        phone.wait_for_text("simulation time t")
        wait_until(lambda: phone.page.evaluate(SCHEME) == "dark", "it is dark from the start")
        wait_until(lambda: phone.box(EI).input_value() == "20", "the late one sees the value")
        phone.press("Pause")
        page.wait_for_text("Paused")
        phone.enter(EI, "30")
        wait_until(lambda: page.box(EI).input_value() == "30", "the first one sees the second one's value")
        wait_until(lambda: np.allclose(page.beam_vertex(), phone.beam_vertex(), atol=1e-6), "both draw the same beam")
        page.rest()
        all_is_on_the_screen(phone, "390x844-dark")
        turn(phone, "light")
        for name in ("Motion", "Guide"):
            heading = phone.page.get_by_role("button", name=f"Expand panel {name}", exact=True)
            below = phone.page.get_by_text("simulation time t")
            wait_until(lambda h=heading, b=below: is_above(h, b), f"{name} is found above the plots")
            heading.click()
        phone.wait_for_text("Mid-span deflection, true size")
        wait_until(lambda: phone.page.evaluate(OVERFLOWING) == [], "nor is anything cut beside open plots", 20)
        assert not phone.errors
    page.rest(False)
    page.press("Play")
    wait_until(lambda: page.snapshot.playing, "the lab goes on when one leaves")


def test_large_bending_is_flagged(page: LabPage) -> None:
    page.enter(EI, "0.2")
    page.wait_for_text("Large deflection")
    page.wait_for_text("5 %")


def test_a_run_that_cannot_go_on_says_why(page: LabPage) -> None:
    page.session.lab_state.load(load_preset("paper").replace({"trajectory.amplitude": (0.9, 0.2, 0.2)}), "far")
    page.wait_for_text("Stopped")
    page.wait_for_text("cannot reach")
    page.picture("stopped")
    page.choose("Preset", "paper")
    page.press("Play")
    wait_until(lambda: page.snapshot.playing, "another preset runs")
