"""What the buttons of the teacher's page do, pressed in a real browser."""

from pathlib import Path

from browser_window import open_window
from http_client import looking, wait_until
from person import TEACHER, TOKEN, Person
from playwright.sync_api import Browser

from flexlab.presets import load_preset
from flexlab.server.front_server import open_front_server
from flexlab.server.settings import Settings


def test_each_button_of_the_class_and_of_a_lab_does_what_it_says(plain_chromium: Browser, tmp_path: Path):
    settings = Settings(
        tmp_path, port=0, token=TOKEN, teacher_token=TEACHER, private=True, max_sessions=1, shadows=False
    )
    with open_front_server(settings, load_preset("paper"), "paper") as server:
        anna = Person(server)
        anna.post("/name", ("name", "Anna"), ("enter", "yes"))
        path = anna.ask("/lab/").headers["Location"]
        window = open_window(plain_chromium, 1280, 800)
        page = window.new_page()
        page.goto(f"http://127.0.0.1:{server.port}/?token={TEACHER}")
        page.get_by_role("link", name="Class").click()
        asked: list[str] = []
        with looking(server.url, path.rstrip("/"), anna.cookies):
            tile = page.locator("#labs > *").filter(has_text="Anna")
            state = tile.locator("[data-field=state]")

            def press(label: str, answers: bool, comes: str) -> None:
                page.once("dialog", lambda ask: (asked.append(ask.message), ask.accept() if answers else ask.dismiss()))
                page.get_by_role("button", name=label, exact=True).click()
                wait_until(lambda: state.inner_text() == comes, f"{label}: {comes}")

            wait_until(lambda: state.inner_text() == "running", "the lab runs")
            press("Pause all", False, "running")
            press("Pause all", True, "paused")
            assert page.locator("#said").inner_text() == "1 lab paused."
            press("Resume all", True, "running")
            assert asked == ["Pause every lab of the class?"] * 2 + ["Let every lab of the class go on?"]
            tile.get_by_role("button", name="Pause", exact=True).click()
            wait_until(lambda: state.inner_text() == "paused", "this one pauses")
            tile.get_by_role("button", name="Resume", exact=True).click()
            wait_until(lambda: state.inner_text() == "running", "and goes on")
            assert len(asked) == 3, "of one lab nobody is asked"
            page.locator("select[name=preset]").select_option("soft-beam")
            press("Send to all", True, "running")
            title = load_preset("soft-beam").title
            wait_until(lambda: tile.locator("[data-field=title]").inner_text() == title, "the preset comes")
        window.close()
