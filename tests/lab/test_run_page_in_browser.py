"""A run in one HTML file opens from disk without network: it moves, the plots follow, nothing is fetched."""

from pathlib import Path

import pytest
from lab_page import wait_until
from playwright.sync_api import Browser

import flexlab
from flexlab.errors import StudyError
from flexlab.files import write_text
from flexlab.guide import LessonProgress
from flexlab.lab.run_page import MOST_FRAMES, Noted, frame_times, run_page

CURSOR = """() => {
  const [cursor, axes] = ["#cursor", "#axes_1 #patch_2 path"]
    .map((name) => document.querySelector(name).getBoundingClientRect());
  return [Number(document.querySelector("#instant").textContent), (cursor.left - axes.left) / axes.width]; }"""
"""The shown instant, s, and the place of the plots' cursor along the time axis, 0 to 1."""


def test_a_page_of_ten_seconds_is_under_three_megabytes_and_escapes_names(tmp_path: Path):
    scenario = flexlab.load_preset("paper").replace({"title": "<script>alert(1)</script>"})
    run = flexlab.simulate(scenario, 10.0)
    page = run_page(run, "<b>mine</b>")
    assert len(page.encode()) < 3_000_000
    assert "<script>alert" not in page
    assert "<b>mine" not in page
    assert len(frame_times(run)) == 301
    with pytest.raises(StudyError, match="no samples"):
        run_page(flexlab.simulate_many([{"gravity": 99}], progress=False)[0], "none")
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match="cannot be written"):
        write_text(tmp_path / "file" / "a.html", page)
    assert MOST_FRAMES >= 3000


def test_a_page_plays_from_disk_without_network_in_the_colour_scheme_of_the_system(chromium: Browser, tmp_path: Path):
    question, guess = "How often does the beam swing in a second, if it is as stiff?", "twice as often as before"
    lesson = LessonProgress("Lesson 9: Stiffness", 2, question, (guess, "as often"), "as often", guess, "")
    write_text(tmp_path / "run.html", run_page(flexlab.simulate("paper", 3.0), "paper", Noted(lessons=(lesson,))))
    context = chromium.new_context(offline=True, viewport={"width": 390, "height": 800}, color_scheme="dark")
    page = context.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((tmp_path / "run.html").as_uri())
    seen: dict[float, float] = {}

    def moves() -> bool:
        seen.update([page.evaluate(CURSOR)])
        return len(seen) >= 3

    wait_until(moves, "the instant under the picture changes", 60)
    assert list(seen.values()) == pytest.approx([time / 3.0 for time in seen], abs=0.005), "the cursor is there"
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    picture = page.frame_locator("#picture").locator("html")
    wait_until(lambda: picture.get_attribute("data-mantine-color-scheme") == "dark", "the picture is dark", 60)
    page.emulate_media(color_scheme="light")
    page.reload()
    wait_until(lambda: picture.get_attribute("data-mantine-color-scheme") == "light", "the picture is light", 60)
    assert not [url for url in asked if url.startswith(("http:", "https:", "ws:", "wss:"))]
    context.close()
