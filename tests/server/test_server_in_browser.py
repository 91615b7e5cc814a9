"""What a person sees who opens the server in a real browser."""

import hashlib
import io
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from browser_window import PICTURES, SOFTWARE_RENDERING, open_window
from get_browser import find_browser
from http_client import ARTIFACTS, PATIENCE, wait_until
from person import TOKEN
from PIL import Image
from playwright.sync_api import Browser, Locator, Page, Response

from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.server.front_server import FrontServer
from flexlab.server.labs import state_of
from flexlab.sim.simulate import simulate
from flexlab.views import OLIVE, VIOLET

SCENE = """() => window.__viserMutable?.nodeRefFromName?.['/beam'] != null
  && window.__viserTestpoints.rendererInfo.render.frame > 2"""
PLOTTED = "() => Object.values(window.__viserTestpoints?.uplots ?? {}).some(({ chart }) => chart.data[0].length > 10)"
WORD_IS_FREE = """() => {
  const word = document.querySelector(".fl-no-picture"), box = word.getBoundingClientRect();
  return [box.top + 1, box.bottom - 1].every((y) => document.elementFromPoint(box.left + box.width / 2, y) === word); }"""
"""Whether nothing lies over the notice that the scene cannot be drawn."""

LISTEN = """() => addEventListener("message", ({ data }) => {
  const time = typeof data === "string" && data.startsWith("{") ? JSON.parse(data).time : undefined;
  if (time !== undefined) window.told = Math.round(time / 1e6) / 1e3; })"""
"""Keeps the time that the viewer reported last, s."""

SMALL = 1024, 640
"""Size of windows with rerun's viewer, px: each pixel of a picture costs processor time."""
MILLI = 1e3
BETWEEN_PICTURES = 1.0
"""Time between two screenshots, s: each makes the viewer draw, which takes a whole processor."""
NEAR, SHARE = 24, 0.0005
"""How near to its colour, of 255, a curve's pixels are, and the least share of the plots that curves and legends cover."""

pytestmark = pytest.mark.usefixtures("few_pictures")

PART = 8_000_000
"""Most bytes of a recording that the viewer requests at once."""


@contextmanager
def window(browser: Browser, url: str, size: tuple[int, int] = (1280, 800), **options) -> Iterator[Page]:
    """Open a browser window without cookies; fail on errors in its page and on requests to any other address."""
    context = open_window(browser, *size, **options)
    page = context.new_page()
    strangers: list[str] = []
    errors: list[str] = []

    def note(address: str) -> None:
        here = urlsplit(address)
        if here.scheme not in ("data", "blob", "about") and here.netloc != urlsplit(url).netloc:
            strangers.append(address)

    # The context tells of requests by frames and workers too, the page does not.
    context.on("request", lambda request: note(request.url))
    page.on("websocket", lambda plug: note(plug.url))
    page.on("pageerror", lambda error: errors.append(str(error)))
    try:
        page.goto(url)
        yield page
    finally:
        context.close()
    assert strangers == []
    assert errors == []


def picture(page: Page, name: str) -> None:
    """Save a screenshot for people to look at, if they asked for it."""
    if PICTURES:
        ARTIFACTS.mkdir(exist_ok=True)
        page.screenshot(path=ARTIFACTS / f"{name}.png")


def wait_for_plots(page: Page, name: str, patience: float = PATIENCE) -> None:
    """Wait until the viewer in the page shows curves, at most `patience` s; save a screenshot."""
    page.frame_locator("#viewer").locator("canvas").wait_for(timeout=MILLI * patience)

    def plotted() -> bool:
        image = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)
        plots = image[:, 2 * image.shape[1] // 3 :]
        return all((abs(plots - color).max(axis=2) < NEAR).mean() > SHARE for color in (VIOLET, OLIVE))

    wait_until(plotted, "the viewer draws the plots", patience, BETWEEN_PICTURES)
    picture(page, name)


@pytest.mark.parametrize("private", [False, True])
def test_a_page_reconnects_to_a_restarted_server(
    plain_chromium: Browser, open_another: Callable[..., FrontServer], private: bool
):
    first = open_another(private=private)
    path = "lab/" if private else "lab/soft-beam"  # A deep link shows its preset.
    with window(plain_chromium, f"{first.url}{path}?fixedDpr=0.5") as page:
        page.wait_for_function(SCENE, timeout=1000 * PATIENCE)
        if not private:
            assert urlsplit(page.url).path == "/lab/"
            wait_until(lambda: "A soft beam" in page.locator("body").inner_text(), "the panel names the preset")
        first.close()
        word = page.locator(".server-word")
        # A page that asks while the lab closes is told that it is closed; one that asks later gets no answer.
        word.and_(page.get_by_role("alert")).filter(has_text=re.compile("The lab does not answer|closed")).wait_for()
        picture(page, "server-gone")
        if not private:
            # The page may also be told that the lab is closed: a server without a shared lab says so.
            other = open_another(private=True, port=first.port)
            word.filter(has_text="closed").wait_for()
            other.close()
        second = open_another(private=private, port=first.port)
        wait_until(lambda: [lab.visitors for lab in second.places.running()] == [1], "the page is in the new lab")
        page.wait_for_function(SCENE, timeout=1000 * PATIENCE)
        word.wait_for(state="hidden")
        wait_until(lambda: state_of(second.places.running()[0]) == "running", "the new run goes on")


def test_without_webgl_the_run_goes_on_and_panel_and_plots_work(
    chromium: Browser, open_another: Callable[..., FrontServer]
):
    front_server = open_another()
    (lab,) = front_server.places.running()
    blind = chromium.browser_type.launch(
        executable_path=find_browser(), args=[*SOFTWARE_RENDERING, "--disable-3d-apis"]
    )
    with window(blind, f"{front_server.url}lab/") as page:
        page.get_by_text("This browser cannot draw the scene").wait_for()
        wait_until(lambda: state_of(lab) == "running", "the run goes on")
        page.get_by_text("Motion", exact=True).first.click()
        page.get_by_text("Tracking error", exact=True).first.wait_for()
        page.wait_for_function(PLOTTED)
        page.wait_for_function(WORD_IS_FREE)
        page.get_by_label("Control law", exact=True).first.wait_for()
        page.keyboard.press("Space")
        wait_until(lambda: state_of(lab) == "paused", "keys reach the lab")
        picture(page, "server-without-webgl")
    blind.close()


def test_signing_in_leads_to_the_requested_page(plain_chromium: Browser, open_another: Callable[..., FrontServer]):
    front_server = open_another(token=TOKEN)
    with window(plain_chromium, f"http://127.0.0.1:{front_server.port}/lab/?fixedDpr=0.5") as page:
        picture(page, "server-sign-in")
        page.get_by_label("Token").fill(TOKEN)
        page.get_by_role("button", name="Open").click()
        page.wait_for_url("**/lab/?fixedDpr=0.5")
        page.wait_for_function(SCENE, timeout=1000 * PATIENCE)


def presets_of(rows: Locator) -> list[str]:
    """The preset of each row of the library, from the top."""
    return [next(name for name in ("alpha", "beta", "gamma") if name in text) for text in rows.all_inner_texts()]


def test_the_library_finds_and_sorts(plain_chromium: Browser, open_another: Callable[..., FrontServer], recorded: Path):
    front_server = open_another()
    for name in ("2026-01-01T00-00-00-alpha", "2026-01-02T00-00-00-beta", "2026-01-03T00-00-00-gamma"):
        shutil.copy(recorded, front_server.settings.logs / f"{name}.rrd")
    with window(plain_chromium, f"{front_server.url}runs", color_scheme="dark") as page:
        rows = page.locator("#runs tbody tr:visible")
        page.get_by_role("searchbox").fill("ALPHA complete")
        assert rows.count() == 1
        page.get_by_role("searchbox").fill("2026-01-0")
        page.get_by_role("columnheader", name="Preset").click()
        assert presets_of(rows) == ["alpha", "beta", "gamma"]
        page.get_by_role("columnheader", name="Preset").press("Space")
        assert presets_of(rows) == ["gamma", "beta", "alpha"]
        page.get_by_role("searchbox").fill("nothing like this")
        page.get_by_text("No run matches.").wait_for()
        picture(page, "server-runs")
        page.get_by_role("searchbox").fill("beta")
        rows.get_by_role("link", name="Delete").click()
        page.get_by_role("button", name="Delete").click()
        page.get_by_role("searchbox").wait_for()
    assert not (front_server.settings.logs / "2026-01-02T00-00-00-beta.rrd").exists()


def test_a_long_recording_comes_part_by_part(chromium: Browser, front_server: FrontServer, root: Path):
    """Proxies that hold an answer until it is complete, such as a hub's, fail to pass on a long one."""
    file = write_run(simulate(load_preset("paper"), 20.0), front_server.settings.logs, "long")
    whole = hashlib.sha256(file.read_bytes()).hexdigest()
    script = (root / "flexlab" / "server" / "static" / "fetch_recordings.js").read_text(encoding="utf-8")
    with window(chromium, front_server.address("/runs")) as page:
        answers: list[int] = []

        def note(answer: Response) -> None:
            if answer.url.endswith(file.name):
                answers.append(int(answer.headers["content-length"]))

        page.on("response", note)
        found = page.evaluate(
            f"""async (address) => {{ {script}
                const answer = await fetch(address), bytes = await answer.arrayBuffer();
                const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
                return [answer.status, Array.from(digest, (x) => x.toString(16).padStart(2, "0")).join("")]; }}""",
            front_server.address(f"/runs/{file.stem}.rrd"),
        )
        assert found == [200, whole]
        assert sum(answers) == file.stat().st_size
        assert len(answers) == 1 + file.stat().st_size // PART
        assert max(answers) <= PART
    file.unlink()


def test_a_run_opens_in_the_viewer_without_a_request_to_any_other_server(
    chromium: Browser, open_another: Callable[..., FrontServer], recorded: Path
):
    # A token makes this the harder case, because the viewer sends no cookies.
    front_server = open_another(token=TOKEN)
    shutil.copy(recorded, front_server.settings.logs / recorded.name)
    with window(chromium, front_server.address(f"/runs/{recorded.stem}"), SMALL) as page:
        page.evaluate(LISTEN)
        wait_for_plots(page, "server-review")
        time = page.locator('form[action$="/continue"] [name="time"]')
        wait_until(time.input_value, "the viewer tells where its cursor is")
        # The viewer plays to the end by itself; if it stops earlier on a slow machine, Continue takes that time.
        wait_until(
            lambda: float(time.input_value()) in (0.5, page.evaluate("window.told")),
            "Continue's time is that of the viewer's cursor",
        )
        assert page.evaluate("document.activeElement.tagName") == "BODY", "the viewer takes no focus by itself"
        page.keyboard.press("Tab")
        assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
        page.keyboard.press("Enter")
        assert page.evaluate("document.activeElement.tagName") == "MAIN"
        page.locator("a.danger").focus()
        page.keyboard.press("Tab")
        wait_until(lambda: page.evaluate("document.activeElement.id") == "viewer", "the viewer is reached by keyboard")

        def has_left() -> bool:
            page.keyboard.press("Tab")
            return page.evaluate("document.activeElement.id") != "viewer"

        wait_until(has_left, "and left again")


def test_an_invalid_study_is_explained_in_its_form_which_keeps_what_was_typed(
    plain_chromium: Browser, front_server: FrontServer
):
    with window(plain_chromium, f"{front_server.url}studies") as page:
        form = page.locator("form").filter(has_text="Start the sweep")
        lower, values, start = form.locator("[name=low1]"), form.locator("[name=count2]"), form.get_by_role("button")
        lower.fill("1O0")
        values.fill("7")
        start.click()
        problem = form.get_by_role("alert")
        problem.get_by_text("'1O0' is not a number").wait_for()
        assert (lower.input_value(), values.input_value()) == ("1O0", "7")
        assert page.url == f"{front_server.url}studies"
        lower.fill("100")
        form.locator("[name=duration]").fill("0.05")
        start.click()
        page.wait_for_url(re.compile("/studies/.+"))
        page.get_by_role("heading", name="Sweep").wait_for()
