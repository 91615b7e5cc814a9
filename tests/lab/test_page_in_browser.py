"""What the lab's own part of the page does: runs wait for it, and its charts share one time axis."""

import contextlib
import time

import pytest
from lab_page import READY, LabPage, wait_until
from lasting_window import LastingWindow

from flexlab.lab.lab_state import Outside
from flexlab.lab.session import Session
from flexlab.presets import load_preset

RANGES = """() => Object.values(window.__viserTestpoints.uplots).filter((u) => u.chart.root.offsetParent)
  .map((u) => [u.chart.scales.x.min, u.chart.scales.x.max])"""
POINTS = """() => { const { chart } = Object.values(window.__viserTestpoints.uplots)[0];
  const { min, max } = chart.scales.x;
  return Array.from(chart.data[0]).filter((t) => t >= min && t <= max).length; }"""
LAID_OUT_ANEW = """() => { // [the parts whose box differs by the sheet itself, how many were compared]
  const parts = [...document.querySelectorAll('[data-fl-rule], [data-fl-rule] *')];
  const boxes = () => parts.map((part) => {
    const { x, y, width, height } = part.getBoundingClientRect();
    return [part.tagName, part.className, getComputedStyle(part).display, ...[x, y, width, height].map(Math.round)].join(' '); });
  const marked = boxes();
  for (const sheet of document.querySelectorAll('style'))
    if (sheet.textContent.includes('.fl-unseen')) sheet.textContent = `${sheet.textContent} `;
  return [boxes().filter((box, index) => box !== marked[index]), parts.length]; }"""
MARKED = """() => window.flexlabAsked.map(({ selector, marked }) =>
  [selector, marked.size, [...document.querySelectorAll(selector)].filter((part) => marked.has(part)).length])"""

FLOATS_AT_ONCE = """async () => {
  const words = document.querySelector('.fl-scrub').parentElement, bar = words.nextElementSibling, copy = bar.cloneNode(true);
  for (const part of [copy, ...copy.querySelectorAll('*')]) part.removeAttribute('data-fl-rule');
  document.body.append(Object.assign(document.createElement('button'), { id: 'new' })); // begins a round or waits for one
  await null;
  bar.replaceWith(copy);
  await null;
  const found = getComputedStyle(copy).position;
  copy.replaceWith(bar);
  document.getElementById('new').remove();
  return found; }"""

ASKED_IN_A_WHILE = """() => new Promise((done) => {
  let count = 0;
  const add = () => { count += 1; };
  addEventListener('flexlab-structure', add);
  setTimeout(() => { removeEventListener('flexlab-structure', add); done(count); }, 2500); })"""
"""How often the structure of a page is evaluated in 2.5 s, enough for two rounds."""


def test_a_run_waits_for_its_picture_and_then_begins_by_itself(window: LastingWindow) -> None:
    window.rest()
    session = Session(load_preset("paper"), "paper", port=window.port, shadows=False, attended=True)
    window.adopt(session)  # The tests below need no other lab.
    session.start()
    time.sleep(0.3)
    assert session.runner.snapshot.waiting
    page = window.show(session)
    wait_until(lambda: float(page.snapshot.latest.time[0]) > 0.1, "the run begins by itself")
    page.choose("Preset", "smooth-start")
    wait_until(lambda: page.snapshot.name == "smooth-start", "another preset")
    wait_until(lambda: float(page.snapshot.latest.time[0]) > 0.1, "it begins by itself as well")
    run = page.snapshot.run_number
    page.choose("Preset", "smooth-start")
    wait_until(lambda: page.snapshot.run_number > run, "the preset chosen once more starts anew")
    page.hold()
    page.press("Reset")
    page.press("Play from t = 0 s")
    wait_until(lambda: float(page.snapshot.latest.time[0]) > 0.1, "the big button plays")
    assert not page.errors


def test_the_buttons_stay_where_they_are_when_the_rate_of_recording_is_known(page: LabPage) -> None:
    """The rate, which is known a few seconds after a start and gone after a pause, took a second line."""
    heights = []
    for said in ("Recording to 2026-11-30T09-00-29-paper.rrd", "Recording to 2026-11-30T09-00-29-paper.rrd, 38 MB/min"):
        page.session.lab_state.outside = Outside(recording=lambda said=said: said)
        page.wait_for_text(said)
        box = page.page.get_by_role("button", name="Pause", exact=True).bounding_box()
        heights.append(box and box["y"])
    page.session.lab_state.outside = Outside()
    assert heights[0] == heights[1]


def test_the_bar_that_looks_back_appears_in_the_picture(page: LabPage) -> None:
    """It appeared at the head of the panel, which it moved for a fraction of a second, until the next round of `structure.js`."""
    wait_until(lambda: page.page.get_by_role("slider", name="Look back").count(), "there is something to look back at")
    assert page.page.evaluate(FLOATS_AT_ONCE) == "fixed"


def test_charts_of_a_tab_keep_one_time_axis_and_grow_finer_where_they_are_zoomed(page: LabPage) -> None:
    wait_until(lambda: float(page.snapshot.latest.time[0]) > 2.0, "two seconds of signals")
    chart = page.page.locator(".uplot .u-over").first

    def spans() -> list[float]:
        return [last - first for first, last in page.page.evaluate(RANGES)]

    def zoomed() -> bool:
        """Zoom by a drag; false if it missed, as on a page still being laid out, whose chart moves meanwhile."""
        box = chart.bounding_box()
        assert box is not None
        page.page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + 50)
        page.page.mouse.down()
        page.page.mouse.move(box["x"] + 0.3 * box["width"], box["y"] + 50, steps=5)
        page.page.mouse.up()
        with contextlib.suppress(AssertionError):
            wait_until(lambda: all(0.3 < span < 0.8 for span in spans()), "all charts are zoomed", 5.0)
            return True
        chart.dblclick()  # Show all of it again, whatever the drag did.
        return False

    wait_until(zoomed, "a drag over a part of a chart shows that part in all of them")
    wait_until(lambda: page.page.evaluate(POINTS) > 100, "the zoomed part is finer")

    def together() -> bool:
        first, *others = page.page.evaluate(RANGES)
        return all(other == pytest.approx(first, abs=0.02) for other in others)

    wait_until(together, "they show the same part")
    run = page.snapshot.run_number
    page.key("r")
    wait_until(lambda: page.snapshot.run_number > run, "a new run")
    wait_until(lambda: all(abs(span - spans()[0]) < 0.02 for span in spans()), "still one axis")
    chart.dblclick()
    wait_until(lambda: all(span == pytest.approx(5.0, rel=0.05) for span in spans()), "all charts are whole again")
    assert not page.errors


def test_escape_closes_the_list_of_keys(page: LabPage) -> None:
    page.key("Shift+?")
    page.wait_for_text("Ctrl+K opens the palette")
    page.page.keyboard.press("Escape")
    wait_until(lambda: "Ctrl+K opens the palette" not in page.text(), "the list is closed")


def test_marked_parts_are_laid_out_as_by_the_style_sheet_itself(page: LabPage) -> None:
    """Among competing rules the same one wins, and the marks follow the parts that come and go."""
    page.choose("Preset", "single-arm")
    wait_until(lambda: page.snapshot.name == "single-arm", "another preset")
    page.open_tab("Touch")
    page.open_tab("Parameters")
    page.hold()
    page.catch_up()
    marked = page.page.evaluate(MARKED)
    assert len(marked) > 30
    assert [selector for selector, *counts in marked if len(set(counts)) > 1] == []
    for present in (False, True):
        if present:
            page.key("b")
            wait_until(lambda: page.page.locator(".fl-number").is_visible(), "a presentation")
        different, compared = page.page.evaluate(LAID_OUT_ANEW)
        assert different == []
        assert compared > 100
        if not present:
            page.page.reload()
            page.page.wait_for_function(READY)
            page.catch_up()
    page.key("b")
    assert not page.errors


def test_the_structure_of_a_page_at_rest_is_not_evaluated_again(page: LabPage) -> None:
    """Removing a mark that a part did not have counted as a change, though it changed nothing: each round caused the next."""
    page.hold()
    page.catch_up()
    wait_until(lambda: page.page.evaluate(ASKED_IN_A_WHILE) == 0, "nobody asks", 30)
