"""The bar below the picture that goes back in time: by mouse and keyboard, with its value in words, in a real browser."""

from lab_page import MID_VERTEX, LabPage, wait_until
from playwright.sync_api import Locator

TIMES = """() => Object.values(window.__viserTestpoints.uplots).map(({ chart }) => chart)
  .filter((chart) => chart.root.offsetParent !== null)
  .map((chart) => Number(chart.root.querySelector('.u-legend .u-value').textContent))"""
"""The times t in the legends of the charts on the screen, s."""


def bar(page: LabPage) -> Locator:
    found = page.page.get_by_role("slider", name="Look back", exact=True)
    found.wait_for()
    return found


def shown_time(page: LabPage) -> float:
    return float(page.page.locator(".fl-grid > :first-child > :last-child").inner_text().removesuffix(" s"))


def test_scene_and_plots_show_a_past_instant_and_a_run_continues_from_there(page: LabPage) -> None:
    wait_until(lambda: page.snapshot.latest.time[0] > 2.0, "there is something to look back at")
    page.catch_up()  # The bar of a page that has just opened may span the first tenths of a second only.
    assert bar(page).get_attribute("aria-valuetext") == "now"
    box = bar(page).bounding_box()
    assert box is not None
    page.page.mouse.move(box["x"] + 4, box["y"] + 5)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] - 60, box["y"] + 5, steps=3)
    page.page.mouse.up()
    wait_until(lambda: not page.snapshot.playing, "the run holds")
    page.page.get_by_text("Paused: ").wait_for()
    page.catch_up()
    now = float(page.snapshot.latest.time[0])
    ago = float(bar(page).get_attribute("aria-valuetext").removesuffix(" s ago"))  # type: ignore[union-attr]
    assert ago > 0.1
    wait_until(lambda: abs(shown_time(page) - (now - ago)) < 0.002, "the panel tells of the instant")
    wait_until(lambda: all(abs(time - (now - ago)) < 0.02 for time in page.page.evaluate(TIMES)), "so do the plots")
    there = page.page.evaluate(MID_VERTEX)
    bar(page).focus()
    for _ in range(20):
        page.page.keyboard.press("ArrowLeft")
    wait_until(lambda: page.page.evaluate(MID_VERTEX) != there, "the keys go further back, and the scene with them")
    assert page.snapshot.latest.time[0] == now, "an arrow on the bar is not a step of the run"
    run, since = page.snapshot.run_number, shown_time(page)
    page.press("Continue from here")
    wait_until(lambda: page.snapshot.run_number == run + 1 and page.snapshot.playing, "a run goes on")
    assert abs(page.snapshot.start_time - since) < 0.2
    wait_until(lambda: bar(page).get_attribute("aria-valuetext") == "now", "the bar is back at its end")
    assert not page.errors


def test_back_to_now_shows_the_present_and_the_run_goes_on(page: LabPage) -> None:
    wait_until(lambda: page.snapshot.latest.time[0] > 1.0, "there is something to look back at")
    bar(page).focus()
    page.page.keyboard.press("Home")
    wait_until(lambda: not page.snapshot.playing, "the run holds")
    page.catch_up()  # The bar reaches the start of the run once the run has stopped.
    page.page.keyboard.press("Home")
    wait_until(lambda: shown_time(page) == 0.0, "its beginning")
    page.press("Back to now")
    wait_until(lambda: page.snapshot.playing, "the run goes on")
    wait_until(lambda: shown_time(page) > 1.0, "the present")
    onward = page.page.get_by_role("button", name="Continue from here")
    wait_until(lambda: not onward.is_visible(), "no button to continue from an earlier instant")


def test_the_tab_key_leads_from_the_bar_to_the_panel(page: LabPage) -> None:
    wait_until(lambda: page.snapshot.latest.time[0] > 0.2, "there is something to look back at")
    bar(page).focus()
    page.page.keyboard.press("Tab")
    assert page.page.evaluate("document.activeElement.textContent.trim()") == "Pause"
    button = page.page.get_by_role("button", name="Pause", exact=True).bounding_box()
    assert button is not None
    assert button["x"] > 1000, "the panel's button stays there"
