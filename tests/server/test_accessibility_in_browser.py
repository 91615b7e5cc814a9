"""Every page, light and dark, works for people who use a keyboard, a screen reader or strong contrast."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from axe_playwright_python.base import AXE_SCRIPT
from browser_window import REST, open_window
from full_server import PAGES, full_server
from http_client import wait_until
from person import TEACHER
from playwright.sync_api import Browser, Page, ViewportSize

from flexlab.text import number_text

GRAVE = ("serious", "critical")
"""Severities of axe's findings that no page may have."""
TABS = ("View", "Touch", "Modes", "Compare", "File", "Events")
"""The panel's tabs after the one that is open at first."""
FINDINGS = "async ([part, options]) => (await axe.run(part ?? document, options)).violations"
OF_COLORS = ["color-contrast", "link-in-text-block"]
"""Rules of axe whose findings depend on the colour scheme."""
USUAL, SMALLEST = ViewportSize(width=1440, height=900), ViewportSize(width=320, height=640)
"""Sizes of the usual window and of the narrowest one in which no page scrolls sideways, px."""
CALM, LOOKS = 1100, 10
"""Time in which a page names new elements for screen readers, ms, and how often a busy page is checked for that."""
PANEL, DIALOG = '[data-dock-region="right"]', '[role="dialog"]'


@pytest.fixture(scope="module")
def page(
    plain_chromium: Browser, recorded: Path, tmp_path_factory: pytest.TempPathFactory, few_pictures: None
) -> Iterator[Page]:
    """One window for all tests, at the page that asks for the token; the server has two runs and a leaderboard."""
    with full_server(tmp_path_factory.mktemp("accessible"), recorded) as address:
        window = open_window(plain_chromium, **USUAL, base_url=address, reduced_motion="reduce")
        opened = window.new_page()
        # Rerun's viewer is somebody else's page, and all of it is one canvas.
        opened.route("**/viewer/**", lambda request: request.abort())
        opened.goto("/")
        yield opened
        window.close()


def grave(page: Page, part: str | None = None, **options: object) -> list[str]:
    """axe's grave findings on a page, or a part of it: which rule, where and why. Nothing is drawn meanwhile."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE_SCRIPT)
    page.evaluate(REST, True)
    findings = page.evaluate(FINDINGS, [part, {"resultTypes": ["violations"], **options}])
    page.evaluate(REST, False)
    return [
        f"{page.url}: {finding['id']}: {node['html'][:300]}: {node['failureSummary']}"
        for finding in findings
        if finding["impact"] in GRAVE
        for node in finding["nodes"]
    ]


def grave_when_calm(page: Page, part: str | None = None) -> list[str]:
    """The same findings, once the page has named its new elements."""
    for _ in range(LOOKS):
        findings = grave(page, part)
        if not findings:
            break
        page.wait_for_timeout(CALM)
    return findings


def light_and_dark(page: Page, part: str | None = None) -> list[str]:
    """All findings in the present colour scheme, then the findings about colours in the other one."""
    dark = page.evaluate("matchMedia('(prefers-color-scheme: dark)').matches")
    findings = grave_when_calm(page, part)
    scheme = "light" if dark else "dark"
    page.emulate_media(color_scheme=scheme)
    if page.locator("[data-mantine-color-scheme]").count():
        page.locator(f"[data-mantine-color-scheme={scheme}]").wait_for()
    return [*findings, *grave(page, part, runOnly=OF_COLORS)]


def test_the_servers_pages_have_no_grave_findings(page: Page) -> None:
    findings = light_and_dark(page)
    page.get_by_label("Token").fill(TEACHER)
    page.get_by_role("button", name="Open").click()
    page.get_by_role("link", name="Class").wait_for()
    for path in PAGES:
        page.goto(path)
        page.locator("h1").wait_for()
        page.locator(".progress[data-working]").wait_for(state="detached")
        findings += light_and_dark(page)
        page.set_viewport_size(SMALLEST)
        if page.evaluate("document.documentElement.scrollWidth") > SMALLEST["width"]:
            findings.append(f"{path}: scrolls sideways")
        page.set_viewport_size(USUAL)
    assert findings == []


def test_charts_format_numbers_as_the_rest_of_flexlab_does(page: Page) -> None:
    values = [0.0, 1000.0, -0.5, 31.6227, 123456.0, 9.9999e6, 1e7, 2.5e-9, -1e-5, 1e-4]
    page.add_script_tag(url="/static/chart.js")
    assert page.evaluate("(values) => values.map((value) => number(value, 4))", values) == list(
        map(number_text, values)
    )


def test_play_screen_and_lab_have_no_grave_findings_and_work_by_keyboard(page: Page) -> None:
    page.goto(f"/lab/?play&token={TEACHER}")
    page.locator(".fl-summary").wait_for(state="attached")
    page.get_by_role("img", name=re.compile("^The paper's experiment: 2 arms hold a flexible beam. ")).wait_for()
    assert page.url.endswith("/?play"), "viser adds nothing to the address"
    findings = light_and_dark(page)
    stiffness = page.get_by_role("slider", name="Stiffness EI", exact=True)
    assert stiffness.get_attribute("aria-valuetext") == "100 N·m²"
    page.get_by_role("button", name="More").focus()
    page.keyboard.press("Enter")
    slider = page.get_by_role("slider", name="Bending stiffness EI", exact=True)
    slider.focus()
    for _ in range(10):
        page.keyboard.press("ArrowLeft")
    wait_until(lambda: slider.get_attribute("aria-valuetext") == "70.79 N·m²", "it says its value in its unit")
    assert page.locator(".mantine-Slider-label:visible").count() == 0, "no place on the slider is shown as a value"
    assert page.get_by_role("button", name="Pause").count() == 1, "an arrow on a slider is not a step of the run"
    page.keyboard.press("Shift+Tab")
    outline = "() => getComputedStyle(document.activeElement).outline"
    assert "2px" in page.evaluate(outline), "the focus in a field is as visible as on a button"
    page.get_by_role("button", name="Bending stiffness EI: back to its usual value").focus()
    page.keyboard.press("Enter")
    wait_until(lambda: slider.get_attribute("aria-valuetext") == "100 N·m²", "and goes back")
    beam = page.get_by_role("button", name="Beam", exact=True)
    assert beam.get_attribute("aria-expanded") == "true"
    beam.focus()
    page.keyboard.press("Enter")
    wait_until(lambda: beam.get_attribute("aria-expanded") == "false", "Enter folds it")
    page.keyboard.press("Enter")
    page.get_by_role("button", name="Pause", exact=True).press("Enter")
    page.get_by_role("button", name="Play", exact=True).wait_for()
    shown = page.locator(".fl-grid > :first-child > :last-child")
    before = shown.inner_text()
    page.get_by_role("button", name="Step", exact=True).press("Enter")
    wait_until(lambda: shown.inner_text() != before, "Enter steps once")
    for folded in ("Guide", "Motion"):
        page.get_by_role("tab", name=folded, exact=True).focus()
        page.keyboard.press("Enter")
    page.get_by_role("img", name=re.compile(r"^Tracking error\. t \(s\): ")).wait_for()
    folded = page.locator(f"{PANEL} [data-fl-pressed][aria-expanded=false]")
    folded.evaluate_all("heads => heads.forEach((head) => head.click())")
    page.wait_for_timeout(CALM)
    findings += light_and_dark(page)
    for tab in TABS:
        page.get_by_role("tab", name=tab, exact=True).focus()
        page.keyboard.press("Enter")
        page.wait_for_timeout(CALM)
        findings += light_and_dark(page, PANEL) if tab == TABS[-1] else grave_when_calm(page, PANEL)
    page.keyboard.press("t")
    page.get_by_role("status").filter(has_text="first beam frequency").wait_for(state="attached")
    page.keyboard.press("Shift+?")
    page.get_by_role("dialog", name="Keys").get_by_text("Have a screen reader say").wait_for()
    findings += light_and_dark(page, DIALOG)
    page.keyboard.press("Escape")
    page.get_by_role("dialog", name="Keys").wait_for(state="detached")
    assert findings == []
