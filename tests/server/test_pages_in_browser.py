"""What the pages' own scripts do when a line breaks, somebody clicks twice, or a browser refuses storage, in a real browser."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser_window import open_window
from http_client import PATIENCE, over, post, wait_until
from person import open_server
from playwright.sync_api import Browser, BrowserContext, Page, Request

from flexlab.presets import load_preset
from flexlab.recording.store.notes import write_notes
from flexlab.server.front_server import FrontServer
from flexlab.server.pages import language_script
from flexlab.server.scenario_links import encode_scenario

SWEEP = {
    "scenario": encode_scenario(load_preset("paper")), "name": "paper", "kind": "sweep", "duration": "0.05",
    "field1": "payload.bending_stiffness", "low1": "50", "high1": "100", "count1": "2", "field2": "",
}  # fmt: skip
LAB_S_ADDITION = f"""<!doctype html><html lang="en"><head>{language_script()}
<script src="/static/lab.js" data-state="/state/lab" defer></script></head><body></body></html>"""
"""A lab's page with nothing but what the server adds to it."""
NO_STORAGE = """for (const name of ["localStorage", "sessionStorage"]) Object.defineProperty(window, name, {
  get() { throw new DOMException("denied", "SecurityError"); } });"""
"""Script after which a page has no storage, as where a browser blocks cookies."""
CUT = """() => [...document.querySelectorAll("tbody th")].flatMap(({ firstChild: text }) => {
  const part = document.createRange();
  return [...text.nodeValue.matchAll(/\\p{L}+/gu)].filter(({ 0: word, index }) => {
    part.setStart(text, index); part.setEnd(text, index + word.length);
    return new Set([...part.getClientRects()].map((box) => box.top)).size > 1;
  }).map(([word]) => word);
})"""
"""Script that returns the words in the first column of a page's tables that are on two lines."""
BETWEEN_CLICKS, LATER = 150, 1000
"""Time between the clicks of a double click, and time after which a click is a new one, ms."""
RUN = "2025-12-31T12-00-00-two"


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory, recorded: Path) -> Iterator[FrontServer]:
    """A server with a shared lab and a recording."""
    logs = tmp_path_factory.mktemp("logs")
    (logs / f"{RUN}.rrd").write_bytes(recorded.read_bytes())
    with open_server(logs) as opened:
        yield opened


@pytest.fixture
def window(plain_chromium: Browser, request: pytest.FixtureRequest) -> Iterator[BrowserContext]:
    """A window in the language that the test asks for, or in English, without rerun's viewer, at which nobody looks."""
    with open_window(plain_chromium, 1280, 800, locale=getattr(request, "param", "en-US")) as opened:
        opened.route("**/viewer/**", lambda route: route.abort())
        yield opened


def lab_s_addition(window: BrowserContext, server: FrontServer) -> Page:
    page = window.new_page()
    page.route("**/lab/", lambda route: route.fulfill(body=LAB_S_ADDITION, content_type="text/html"))
    page.goto(f"{server.url}lab/")
    return page


def test_a_link_that_is_shown_while_the_line_breaks_leaves_no_notice(window: BrowserContext, server: FrontServer):
    """The notice took the place of the link and stayed after the break, without a button, over the whole lab."""
    page = lab_s_addition(window, server)
    page.get_by_role("button", name="Share").click()
    page.get_by_label("Link to this lab").wait_for()
    page.route("**/state/lab", lambda route: route.abort())
    page.get_by_role("alert").filter(has_text="The lab does not answer").wait_for()
    page.unroute("**/state/lab")
    page.get_by_role("alert").wait_for(state="hidden")


def test_the_link_is_closed_by_escape_and_beside_it(window: BrowserContext, server: FrontServer):
    """Only its two buttons closed it, and the focus was lost."""
    page = lab_s_addition(window, server)
    link = page.get_by_label("Link to this lab")
    beside = page.locator(".server-word")
    for close in (lambda: page.keyboard.press("Escape"), lambda: beside.dispatch_event("click")):
        page.get_by_role("button", name="Share").click()
        link.wait_for()
        close()
        link.wait_for(state="hidden")
        assert page.evaluate("document.activeElement.textContent") == "Share"


def test_a_scenario_that_is_too_long_for_a_link_is_not_shared_as_one(window: BrowserContext, server: FrontServer):
    page = lab_s_addition(window, server)
    page.route("**/state/lab", lambda route: route.fulfill(json={"open": True, "link": "", "live": ""}))
    page.get_by_role("button", name="Share").click()
    notice = page.get_by_role("alert").filter(has_text="This scenario is too long for a link: download it as a file.")
    notice.wait_for()
    page.wait_for_event("response", lambda answer: answer.url.endswith("/state/lab"))
    assert notice.is_visible(), "it stays until it is closed"
    notice.get_by_role("button", name="Close").click()
    notice.wait_for(state="hidden")


@pytest.mark.parametrize("window", ["de-DE"], indirect=True)
def test_a_translated_notice_keeps_its_links(window: BrowserContext, server: FrontServer):
    """It was made anew every 3 s: said again by a screen reader, and the focus on its links was lost."""
    page = lab_s_addition(window, server)
    page.route("**/state/lab", lambda route: route.fulfill(status=503, body=""))
    link = page.get_by_role("alert").get_by_role("link", name="Ein neues Labor öffnen")
    link.focus()
    for _ in range(2):
        page.wait_for_event("response", lambda answer: answer.url.endswith("/state/lab"))
    assert page.evaluate("document.activeElement.textContent") == "Ein neues Labor öffnen"


@pytest.mark.parametrize("window", ["en-US", "de-DE"], indirect=True)
def test_a_panel_of_the_runs_lies_within_the_window(window: BrowserContext, server: FrontServer):
    """Import at 1280 px, and Export on a projector of 1024 px, were cut at the right edge."""
    page = window.new_page()
    for address in ("runs", f"runs/{RUN}"):
        page.goto(f"{server.url}{address}")
        for width in (1280, 1024, 390):
            page.set_viewport_size({"width": width, "height": 800})
            for panel in page.locator("details.pop").all():
                panel.locator("summary").click()
                page.evaluate("() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
                box = panel.locator(":scope > :not(summary)").bounding_box()
                assert box is not None
                assert box["x"] >= 0
                assert box["x"] + box["width"] <= width
                page.keyboard.press("Escape")  # On a phone, an open panel covers the next button.


@pytest.mark.parametrize("window", ["de-DE"], indirect=True)
def test_names_of_laws_are_not_cut_within_a_word_on_a_phone(window: BrowserContext, server: FrontServer):
    page = window.new_page()
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(f"{server.url}leaderboard")
    page.get_by_text("Störgrößenbeobachter").first.wait_for()
    assert page.evaluate(CUT) == []


def test_a_run_of_many_changes_does_not_fill_the_list(window: BrowserContext, server: FrontServer):
    """Its notes, out of sight beside six words for a run that stopped, made its row 270 px high."""
    run = server.settings.logs / f"{RUN}.rrd"
    write_notes(run, changes=["t = 28.390 s: Control law = adaptive-sliding-mode"] * 3, status="diverged")
    page = window.new_page()
    page.goto(f"{server.url}runs")
    row = page.locator("#runs tr").filter(has_text="adaptive-sliding-mode")
    for width in (1024, 720):
        page.set_viewport_size({"width": width, "height": 800})
        wait_until(lambda: (box := row.bounding_box()) and box["height"] < 150, f"a low row at {width} px")


def test_a_map_is_drawn_without_storage(window: BrowserContext, server: FrontServer):
    address = post(server.url, "/studies", SWEEP).headers["Location"]
    over(server.url, f"{address}/state", 4 * PATIENCE)
    window.add_init_script(NO_STORAGE)
    page = window.new_page()
    page.goto(server.url.rstrip("/") + address)
    page.locator("a.cell").nth(1).wait_for()
    page.get_by_label("Show").select_option("1")
    page.locator("#chart figcaption").filter(has_text=page.locator("#metric option").nth(1).inner_text()).wait_for()


def test_a_double_click_sends_a_form_once(window: BrowserContext, server: FrontServer):
    sent: list[Request] = []
    page = window.new_page()
    page.on("request", lambda request: "/export?" in request.url and sent.append(request))
    page.goto(f"{server.url}runs/{RUN}")
    page.get_by_text("Export", exact=True).first.click()
    page.locator("select[name=format]").select_option("csv")
    button = page.get_by_role("button", name="Export", exact=True)
    with page.expect_download():
        button.evaluate(
            "(button, pause) => { button.click(); setTimeout(() => button.click(), pause); }", BETWEEN_CLICKS
        )
    assert len(sent) == 1
    page.wait_for_timeout(LATER)
    with page.expect_download():
        button.click()
    assert len(sent) == 2, "later the same button works again"


@pytest.mark.parametrize("window", ["de-DE"], indirect=True)
def test_the_library_is_searched_in_the_language_that_it_shows(window: BrowserContext, server: FrontServer):
    write_notes(server.settings.logs / f"{RUN}.rrd", status="finished")  # Another test lets it diverge.
    page = window.new_page()
    page.goto(f"{server.url}runs")
    row = page.locator("#runs tbody tr").filter(has_text="vollständig").first
    row.wait_for()
    search = page.get_by_role("searchbox")
    search.fill("vollständig")
    assert row.is_visible()
    search.fill("unsinn")
    row.wait_for(state="hidden")


def test_a_study_s_form_can_be_sent_again_after_going_back(window: BrowserContext, server: FrontServer):
    page = window.new_page()
    page.goto(f"{server.url}studies")
    button = page.get_by_role("button", name=re.compile("Start the")).first
    # A page that a browser kept comes back as it was left.
    button.evaluate("""(button) => { button.disabled = true;
      dispatchEvent(new PageTransitionEvent("pageshow", { persisted: true })); }""")
    assert button.is_enabled()


def test_the_teacher_is_told_that_a_line_gives_no_answer(window: BrowserContext, server: FrontServer):
    page = window.new_page()
    page.goto(f"{server.url}teacher")
    page.locator("#labs > *").first.wait_for()
    page.route("**/teacher/labs", lambda route: None)
    page.get_by_role("status").filter(has_text="The server does not answer: what you see is old.").wait_for()
    page.unroute("**/teacher/labs")
    page.get_by_role("status").filter(has_text="does not answer").wait_for(state="hidden")
