"""What the buttons of the teacher's page do, pressed in a real browser."""

from pathlib import Path

import pytest
from browser_window import PATIENCE, open_window
from http_client import looking, wait_until
from person import TEACHER, TOKEN, Person, open_server
from playwright.sync_api import Browser

from flexlab.presets import load_preset
from flexlab.recording.store.notes import read_notes
from flexlab.recording.store.run_files import list_runs

pytestmark = pytest.mark.usefixtures("few_pictures")


def test_each_button_of_the_class_and_of_a_lab_does_what_it_says(plain_chromium: Browser, tmp_path: Path):
    with open_server(tmp_path, token=TOKEN, teacher_token=TEACHER, private=True, max_sessions=1) as server:
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
            assert asked == ["Pause every lab of the class?"] * 2 + ["Resume every lab of the class?"]
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


def test_the_teacher_sets_the_pace_locks_labs_and_sees_the_guesses(plain_chromium: Browser, tmp_path: Path):
    with open_server(tmp_path, token=TOKEN, teacher_token=TEACHER, private=True, max_sessions=3) as server:
        url = f"http://127.0.0.1:{server.port}"
        student, window = open_window(plain_chromium, 1280, 800), open_window(plain_chromium, 1280, 800)
        lab, page = student.new_page(), window.new_page()
        lab.set_default_timeout(PATIENCE)
        page.set_default_timeout(PATIENCE)
        lab.goto(f"{url}/?token={TOKEN}")
        lab.get_by_label("Your name").fill("Anna")
        lab.get_by_role(
            "link", name="paper", exact=False
        ).first.click()  # A name counts without the form's buttons, too.
        lab.wait_for_url("**/s/**", wait_until="commit")
        lab.goto(f"{url}/lab/?fixedDpr=0.3")
        ben = Person(server)
        ben.post("/name", ("name", "Ben"), ("enter", "yes"))
        ben.ask("/lab/")
        lab.get_by_text("Guide", exact=True).first.click()
        page.goto(f"{url}/?token={TEACHER}")
        page.goto(f"{url}/teacher")
        page.get_by_label("Pace").select_option("Lesson 1: Why does it ring?")
        page.get_by_label("up to step").select_option("1")
        lab.get_by_text("The class is at step 1 of 3 (guess). The teacher opens the next step.").wait_for()
        over_the_scene = lab.get_by_text(
            "The class is at step 1 of 3 (guess) of “Lesson 1: Why does it ring?”: open the Guide"
        )
        wait_until(
            lambda: over_the_scene.count() == 1 and not over_the_scene.is_visible(), "no second time over the scene"
        )
        lab.get_by_text("What rings the beam?").wait_for()
        load, answer = (lab.get_by_role("button", name=name) for name in ("Load paper", "Show the answer"))
        assert (load.count(), answer.count()) == (0, 0), "of later steps nothing is there"
        lab.get_by_role("combobox", name="What do you guess?").or_(lab.get_by_label("What do you guess?")).first.click()
        lab.get_by_role("option", name="the motors").click()
        row = page.get_by_role("row").filter(has_text="the motors")
        wait_until(lambda: row.get_by_role("cell").inner_text() == "1", "the bar of her answer")
        assert "1 of 2 labs have guessed" in page.locator("#questions caption").inner_text()
        tile = page.locator("#labs > *").filter(has_text="Guessed: Lesson 1: the motors")
        assert "Anna" in tile.inner_text()
        page.get_by_label("up to step").select_option("2")
        load.wait_for()
        assert answer.count() == 0
        page.get_by_label("Lock").check()
        state = tile.locator("[data-field=state]")
        wait_until(lambda: state.inner_text() == "paused", "she stands")
        load.click()
        lab.locator(".fl-error").get_by_text("The teacher has locked this lab").wait_for()
        assert state.inner_text() == "paused"
        page.get_by_label("Hide names").check()
        wait_until(lambda: tile.locator("h2").inner_text() == "Student 1", "a number instead of her name")
        assert "Anna" not in page.content()
        run = next(run for run in list_runs(tmp_path) if read_notes(run).get("visitor") == "Anna")
        sheet = page.request.get(f"{url}/runs/{run.stem}/export?format=html", timeout=PATIENCE).text()
        assert "<td>Lesson 1: Why does it ring?</td>" in sheet
        assert "<td>the motors</td><td>–</td>" in sheet, "what is right is told at the last step"
        student.close()
        window.close()
    assert [(met["guess"], met["answer"]) for met in read_notes(run)["lessons"]] == [("the motors", "")]
