"""What a newcomer sees first, in a real browser: the scene, its beam, and few controls."""

import math
from collections.abc import Iterator

import pytest
from browser_window import open_window
from lab_page import BEAM, CLOSE_NOTIFICATIONS, GUIDE_OPEN, PLOTS_OPEN, POINT_PIXEL, READY, address, wait_until
from playwright.sync_api import Browser, Page

from flexlab.lab.scene.beam import SIDES
from flexlab.lab.session import Session
from flexlab.sim.commands import SetSpeed

LEAST_SHARE, LEAST_BEAM = 0.6, 250
"""Least share of the window for the scene; least length of the beam in a window 1440 px wide, px."""
SHARE = """(N) => {
  const picture = window.__viserMutable.canvas; let seen = 0;
  for (let i = 0; i < N; i++) for (let j = 0; j < N; j++) {
    const on = document.elementFromPoint((i + 0.5) / N * innerWidth, (j + 0.5) / N * innerHeight);
    if (on === picture || on?.contains(picture) || picture.parentElement.contains(on)) seen += 1; }
  return seen / (N * N); }"""
"""The share of the window in which a click goes to the scene, by N rows of N points, each of which takes 0.3 ms."""
ON_THE_SCENE = """(points) => points.every(([x, y]) => {
  const picture = window.__viserMutable.canvas, on = document.elementFromPoint(x, y);
  return on !== null && (on === picture || on.contains(picture)); })"""
"""Whether nothing lies over the scene at some points of the page, px."""
KEPT = "localStorage.getItem('flexlab-open-panels')"
CONTROLS = """() => [...document.querySelectorAll('button, [role="slider"], [role="combobox"], [role="tab"]')]
  .filter((part) => part.getClientRects().length && part.closest('[data-fl-panel] > *') && part.textContent.trim() !== '↺'
    && (part.getAttribute('aria-haspopup') === 'listbox' || !part.closest('.mantine-InputWrapper-root'))).length"""
"""Controls in sight in the panel: buttons, sliders, menus and tabs."""
COUNT_SLIDERS = """if (location.search.includes('play')) setInterval(() => {
  const isShown = (part) => part.checkVisibility({ visibilityProperty: true });
  const shown = [...document.querySelectorAll('[role="slider"]')].filter(isShown);
  window.mostSliders = Math.max(window.mostSliders ?? 0, shown.length); }, 20)"""
"""Keeps in `mostSliders` the most sliders that a play screen has shown at once since it was loaded."""


@pytest.fixture(scope="module")
def _window(chromium: Browser, few_pictures: None) -> Iterator[Page]:
    """One window for all tests: the first page of a new one takes seconds of processor time."""
    context = open_window(chromium, 1440, 900)
    yield context.new_page()
    context.close()


@pytest.fixture
def newcomer(_window: Page, shared_session: Session) -> Iterator[Page]:
    """A window without anything stored from earlier visits."""
    kept = {"origin": shared_session.url, "storageTypes": "local_storage,cookies"}
    _window.context.new_cdp_session(_window).send("Storage.clearDataForOrigin", kept)
    _window.set_viewport_size({"width": 1440, "height": 900})
    yield _window
    _window.goto("about:blank")


FIRST_ROW = """() => {
  const box = document.querySelector('[data-floating-window]').getBoundingClientRect();
  const charts = [...document.querySelectorAll('.uplot')].filter((part) => part.getClientRects().length);
  const top = Math.min(...charts.map((part) => part.getBoundingClientRect().top));
  const first = charts.filter((part) => part.getBoundingClientRect().top === top);
  return first.length > 0 && first.flatMap((part) => [...part.querySelectorAll('.u-legend .u-series')])
    .map((part) => part.getBoundingClientRect()).filter((part) => part.height)
    .every((part) => part.bottom <= box.bottom && part.right <= box.right); }"""
"""Whether the first row of charts is in sight down to its legends."""
LEGENDS_ON_A_LINE = """() => {
  const legends = [...document.querySelectorAll(".u-legend")];
  const heights = legends.map((legend) => legend.getBoundingClientRect().height);
  return /x \\(mm\\)\\s*−?\\d\\.\\d{4}/.test(legends[0].innerText) && Math.max(...heights) < 1.5 * Math.min(...heights);
}"""
"""Whether the legends of the plots have one line each, the first with all digits of its numbers."""
FEWEST_TICKS = """() => Math.min(...Object.values(window.__viserTestpoints.uplots).map(({ chart }) => chart)
  .filter((chart) => chart.root.offsetParent !== null).map(({ axes: [, axis], scales: { y: { min, max } } }) =>
    (axis._splits ?? []).filter((value) => value !== null && min <= value && value <= max).length))"""
"""The smallest number of ticks on a vertical axis in sight."""
WIDE = dict.fromkeys(("standard", "sansSerif"), "DejaVu Sans")
TAB_NAMES = """[...document.querySelectorAll('[role="tab"]')].filter((tab) => tab.offsetParent !== null).map((tab) => {
  const words = document.createRange(), box = tab.lastElementChild;
  words.selectNodeContents(box);
  return [tab.textContent, words.getBoundingClientRect().width > box.getBoundingClientRect().width + 0.1]; })"""
"""The name of each tab in sight, and whether it is cut."""
PIXELS = """() => Math.round(100 * Math.min(...[...document.querySelectorAll('.uplot canvas')]
  .filter((part) => part.getClientRects().length).map((part) => part.width / part.getBoundingClientRect().width))) / 100"""
"""Script for the pixels that a chart draws, per pixel of the screen."""
ROUNDED = """() => [...new Set(Object.values(window.__viserTestpoints.uplots)
  .flatMap(({ chart }) => chart.series.slice(1, -1).map((series) => series.pxAlign)))]"""
"""Script for the pixels to which the points of curves are rounded."""
SHEET = """() => document.querySelector('div[style*="position: fixed"][style*="width: 20em"]').getBoundingClientRect().height"""
"""Height of the sheet of a page in one column, px."""
ABOVE_THE_BAR = f"""() => Math.max(...({BEAM})({SIDES}).map(([, y]) => y))
  < document.querySelector('div:has(> .fl-scrub) + div:has(.mantine-Slider-root)').getBoundingClientRect().top"""
WHOLE_PLOT = """() => {
  const box = document.querySelector('[data-floating-window]').getBoundingClientRect();
  const names = [...document.querySelectorAll('.u-legend .u-series')].map((part) => part.getBoundingClientRect());
  const plot = [...document.querySelectorAll('.uplot')].map((part) => part.getBoundingClientRect());
  const seen = [...names, ...plot].filter((part) => part.height > 0);
  return seen.length === 4 && seen.every((part) => part.right <= box.right && part.bottom <= box.bottom); }"""


def opened(page: Page, url: str) -> Page:
    """The page, showing the lab with its beam drawn."""
    page.goto(url)
    return drawn(page)


def drawn(page: Page, closes: bool = True) -> Page:
    """The same page, once its beam is drawn. `closes`: closes the notice that there is no graphics card."""
    page.wait_for_function(READY)
    if closes:
        page.evaluate(CLOSE_NOTIFICATIONS)
    wait_until(lambda: page.evaluate(BEAM, SIDES) is not None, "a beam is drawn")
    return page


def length(ends: list[list[float]]) -> float:
    return math.dist(ends[0], ends[2])


def fills(page: Page, width: int) -> None:
    """Check that the scene has its share of a window of this width, px, and that nothing is cut off."""
    wait_until(lambda: page.evaluate(SHARE, 36) >= LEAST_SHARE, "the scene has its share", 30)
    assert page.evaluate("document.documentElement.scrollWidth") <= width, "nothing is cut off"


def bases_are_in_sight(page: Page) -> None:
    """Check that the scene shows where both arms stand, with nothing over it."""
    edges = [[x, y, 0.0] for base in (-0.5, 0.5) for x, y in ((base - 0.1, 0.0), (base + 0.1, 0.0), (base, -0.1))]
    wait_until(lambda: page.evaluate(ON_THE_SCENE, [page.evaluate(POINT_PIXEL, edge) for edge in edges]), "the bases")


def resized(page: Page, width: int, height: int) -> None:
    """Give the window another size, px, and check that the scene has its share of it."""
    page.set_viewport_size({"width": width, "height": height})
    fills(page, width)


def test_a_phone_shows_the_scene_and_controls_however_it_is_held(
    chromium: Browser, shared_session: Session, few_pictures: None
) -> None:
    """And so does any narrow window; the tests below look at three wide ones."""
    with open_window(chromium, 390, 844, has_touch=True) as window:
        window.add_init_script("Object.defineProperty(navigator, 'platform', { get: () => 'iPhone' })")
        page = window.new_page()
        window.new_cdp_session(page).send("Page.setFontFamilies", {"fontFamilies": WIDE})  # The hardest case.
        page.goto(address(shared_session))
        the_notice_of_no_graphics_card_takes_one_line_and_no_touches(page)
        fills(drawn(page), 390)
        resized(page, 320, 640)
        bases_are_in_sight(page)
        resized(page, 720, 900)  # Here the bases would make the beam shorter than 250 px.
        held_across_it_shows_controls_and_keys_with_a_minus_sign(page)
        # In Firefox on a plain Debian, tabs of the panel read "Paramet…", "Vi…" and "F…".
        page.set_viewport_size({"width": 1440, "height": 900})
        page.get_by_role("tab", name="Parameters", exact=True).wait_for()
        wait_until(lambda: [name for name, cut in page.evaluate(TAB_NAMES) if cut] == [], "the whole names of the tabs")


def the_notice_of_no_graphics_card_takes_one_line_and_no_touches(page: Page) -> None:
    # In one call: on a busy machine it could be gone between being found and being measured.
    look = """() => {
      const word = document.querySelector('[data-fl-no-card]');
      return word && [word.getBoundingClientRect().height, getComputedStyle(word).pointerEvents];
    }"""
    height, touched = page.wait_for_function(look).json_value()
    assert height < 60
    assert touched == "none", "what is behind it is the scene's"


def held_across_it_shows_controls_and_keys_with_a_minus_sign(page: Page) -> None:
    """Below the sheet's head one line was in sight. Boxes asked for an iPhone's keys for decimals, which lack the sign."""
    page.set_viewport_size({"width": 844, "height": 390})
    wait_until(lambda: 0.45 < page.evaluate(SHEET) / 390 < 0.55, "the sheet takes half of the screen")
    seen = "the beam, clear of the bar that looks back"
    wait_until(lambda: page.evaluate(ON_THE_SCENE, page.evaluate(BEAM, SIDES)) and page.evaluate(ABOVE_THE_BAR), seen)
    box = page.get_by_label("Bending stiffness EI (N·m²)", exact=True).first
    box.tap()
    assert box.get_attribute("inputmode") == "text"


def test_plots_are_one_click_away_and_a_browser_remembers_that_they_are_open(
    newcomer: Page, shared_session: Session
) -> None:
    page = newcomer
    page.goto(address(shared_session))
    word = page.get_by_text("Software WebGL rendering detected")
    word.wait_for()
    drawn(page, closes=False)
    fills(page, 1440)
    bases_are_in_sight(page)
    wait_until(lambda: length(page.evaluate(BEAM, SIDES)) >= LEAST_BEAM, "the beam is long enough to be looked at")
    wait_until(lambda: page.title() == "paper · flexlab", "the tab says what it is")
    assert page.evaluate("document.documentElement.dataset.flLabels") == "plain"
    assert not page.evaluate(PLOTS_OPEN)
    assert not page.evaluate(GUIDE_OPEN)
    page.get_by_text("Motion", exact=True).first.click()
    page.wait_for_function(PLOTS_OPEN)
    lefts = "() => [...document.querySelectorAll('.uplot')].map((part) => part.getBoundingClientRect().left)"
    wait_until(lambda: len({round(left) for left in page.evaluate(lefts)}) > 1, "two plots stand side by side")
    wait_until(lambda: page.evaluate(FEWEST_TICKS) >= 3, "the numbers at each vertical axis tell its scale")
    wait_until(lambda: page.evaluate(LEGENDS_ON_A_LINE), "the legend of each plot takes one line")
    word.wait_for(state="detached")  # By itself.
    wait_until(lambda: "plots" in (page.evaluate(KEPT) or ""), "the page keeps it")
    opened(page, address(shared_session)).wait_for_function(PLOTS_OPEN)
    assert not page.evaluate(GUIDE_OPEN)
    beside_the_guide_no_plot_is_cut_off(page)


def beside_the_guide_no_plot_is_cut_off(page: Page) -> None:
    """Check that the scene stays large as well."""
    page.get_by_text("Guide", exact=True).first.click()
    page.wait_for_function(GUIDE_OPEN)
    wait_until(lambda: length(page.evaluate(BEAM, SIDES)) >= LEAST_BEAM, "the beam is long enough to be looked at")
    assert page.evaluate(SHARE, 60) >= 0.39, "of a window whose controls, text and plots are all open"
    for tab in ("Motion", "Torques", "Control", "Energy", "Spectrum"):
        page.get_by_role("tab", name=tab, exact=True).click()
        wait_until(lambda: page.evaluate(FIRST_ROW), f"the plots of {tab} are whole", 30)


def test_a_presentation_shows_the_scene_one_plot_and_one_number(newcomer: Page, shared_session: Session) -> None:
    newcomer.set_viewport_size({"width": 1024, "height": 768})
    page = opened(newcomer, address(shared_session))
    fills(page, 1024)
    page.set_viewport_size({"width": 1920, "height": 1080})
    page.keyboard.press("b")
    page.wait_for_function("() => document.querySelectorAll('.uplot').length > 0")
    page.get_by_text("largest vibration").wait_for()
    shown = "() => [...document.querySelectorAll('.uplot')].filter((part) => part.getClientRects().length).length"
    wait_until(lambda: page.evaluate(shown) == 1, "one plot")
    wait_until(lambda: page.evaluate(SHARE, 36) >= LEAST_SHARE, "the scene has its share", 30)
    assert not page.get_by_role("button", name="Reset").is_visible()
    for width, height in ((1920, 1080), (1366, 768), (1024, 768)):
        page.set_viewport_size({"width": width, "height": height})
        wait_until(lambda: page.evaluate(WHOLE_PLOT), f"the plot is whole, with all three names, at {width} px", 30)
    wait_until(lambda: page.evaluate(PIXELS) >= 1, "the enlarged plot has a pixel for each of the screen's", 30)
    assert page.evaluate(ROUNDED) == [0], "else a slow curve has steps and kinks"
    page.set_viewport_size({"width": 390, "height": 844})
    page.get_by_text("largest vibration").wait_for()
    look_back = page.get_by_text("Look back", exact=True)
    wait_until(lambda: not look_back.is_visible(), "nothing lies over the factor on a phone")
    scale = page.locator("meta[name=viewport]").get_attribute("content") or ""
    assert "minimum-scale=1" in scale, "else a menu that opens makes a phone show all of it smaller, and closes"
    page.set_viewport_size({"width": 1920, "height": 1080})
    page.keyboard.press("b")
    page.get_by_role("button", name="Reset").wait_for()
    wait_until(lambda: not page.evaluate(PLOTS_OPEN), "the plots are folded as before")
    page.get_by_text("Motion", exact=True).first.click()
    page.wait_for_function(PLOTS_OPEN)
    wait_until(lambda: "plots" in (page.evaluate(KEPT) or ""), "the page keeps it")
    page.get_by_role("tab", name="View", exact=True).click()
    page.get_by_role("button", name="Presentation", exact=True).click()
    page.get_by_text("B or Esc ends the presentation.").wait_for()
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Reset").wait_for()
    page.wait_for_function(PLOTS_OPEN)
    wait_until(lambda: page.evaluate(PIXELS) == 1, "the plots are as sharp as before, and no sharper")
    assert "plots" in page.evaluate(KEPT)


def test_the_play_screen_has_five_controls_resets_its_camera_and_leads_to_the_lab_with_the_same_run(
    newcomer: Page, shared_session: Session
) -> None:
    newcomer.add_init_script(COUNT_SLIDERS)
    session, page = shared_session, opened(newcomer, f"{address(shared_session)}&play")
    page.get_by_label("Stiffness EI (N·m²)", exact=True).wait_for()
    assert page.evaluate(CONTROLS) == 5
    assert page.evaluate("window.mostSliders") == 2, "the lab's own do not flash up"
    turned_camera_can_be_reset(page)
    run = session.runner.snapshot.run_number
    page.get_by_role("button", name="Tap", exact=True).click()
    wait_until(lambda: any("tap" in event.text.lower() for event in session.runner.snapshot.events), "a tap")
    page.get_by_label("Stiffness EI (N·m²)", exact=True).fill("20")
    wait_until(lambda: session.runner.snapshot.scenario.payload.bending_stiffness == 20.0, "a softer beam")
    session.lab_state.submit(SetSpeed(1 / 64))
    speed = page.get_by_label("Simulation speed", exact=True)
    wait_until(lambda: speed.input_value() == "1/64 ×", "the speed, written as in the lab")
    session.lab_state.submit(SetSpeed(1.0))
    page.get_by_role("button", name="More", exact=True).click()
    page.get_by_role("button", name="Reset", exact=True).wait_for()
    assert page.evaluate(CONTROLS) > 5
    assert session.runner.snapshot.run_number == run
    assert not page.get_by_label("Stiffness EI (N·m²)", exact=True).is_visible()


def turned_camera_can_be_reset(page: Page) -> None:
    """Check it on a play screen."""
    at = "() => window.__viserMutable.camera.position.toArray().map((part) => Math.round(100 * part))"
    page.get_by_role("button", name="Tap", exact=True).wait_for()
    back = page.get_by_role("button", name="Reset view", exact=True)
    assert not back.is_visible(), "there is nothing to take back"

    def rests() -> bool:
        then = page.evaluate(at)
        page.wait_for_timeout(400)
        return page.evaluate(at) == then

    wait_until(rests, "the camera, which the size of the panel moves once")
    before = page.evaluate(at)

    def turns() -> bool:
        """Whether a drag turns the camera; a page that has just opened takes none for half a second."""
        page.mouse.move(500, 700)
        page.mouse.down()
        page.mouse.move(700, 500, steps=5)
        page.mouse.up()
        page.wait_for_timeout(400)
        return page.evaluate(at) != before

    wait_until(turns, "a turned camera")
    back.press("Enter")
    wait_until(lambda: page.evaluate(at) == before, "the camera as it was")
    back.wait_for(state="hidden")
