"""From the start page to a run that was exported and imported again, as a person does it, in a real browser."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from http_client import PATIENCE, wait_until
from person import Person
from playwright.sync_api import Browser, Locator, TimeoutError
from test_server_in_browser import MILLI, SCENE, SMALL, picture, wait_for_plots, window

from flexlab.presets import load_preset
from flexlab.recording.reader import read_recording
from flexlab.server.front_server import FrontServer

pytestmark = pytest.mark.usefixtures("few_pictures")

PAINTED = "performance.getEntriesByType('paint').length > 0"
"""Whether the page's first picture is drawn: Chromium takes no keys before."""
PRESSES = 3
"""How often one key is pressed before it counts as lost."""
SEEN = 10
"""Time in which a box shows that it was ticked, s."""


def press_until(what: Locator, key: str, seen: Locator, patience: float) -> None:
    """Press a key until `seen` is visible, as a person does: Chromium loses keys while it leaves a page. `patience`: s."""
    for _ in range(PRESSES):
        try:
            what.press(key, timeout=MILLI * PATIENCE)
            return seen.wait_for(timeout=MILLI * patience)
        except TimeoutError:
            if seen.is_visible():  # It took longer than that, and the pressed element is gone.
                return None
    return seen.wait_for(timeout=MILLI * PATIENCE)


@pytest.mark.timeout(600)  # Nine pages, two of them with rerun's viewer, which a busy processor draws for minutes.
def test_from_the_start_page_to_an_imported_run(
    chromium: Browser, open_another: Callable[..., FrontServer], recorded: Path
):
    front_server = open_another()
    for file in (recorded, recorded.with_suffix(".json")):
        shutil.copy(file, front_server.settings.logs / file.name)
    with window(chromium, front_server.url, SMALL) as page:
        picture(page, "way-start")
        page.get_by_role("link", name="Open the lab").click()
        page.wait_for_function(SCENE, timeout=MILLI * PATIENCE)
        place = front_server.places.running()[0]
        assert place.visitors == 1
        wait_until(lambda: place.status().time > 2.0, "two seconds are recorded")
        live = place.status().recording
        assert live is not None
        # On a busy machine the run would go on for minutes, and the short run beside it would be invisible in the plots.
        page.get_by_role("button", name="Pause", exact=True).click(timeout=MILLI * PATIENCE)
        page.get_by_role("button", name="Share").click()
        link = page.locator(".server-word input").input_value()
        assert link.startswith(f"{front_server.url}lab/?scenario=")
        page.locator(".server-word").get_by_role("button", name="Close").click()
        picture(page, "way-lab")

        page.locator("#server-bar").get_by_role("link", name="Runs").click()
        page.get_by_role("searchbox").wait_for()
        wait_until(lambda: place.visitors == 0, "the server knows that the visitor has left")
        page.locator("#runs").get_by_role("link", name=f"{live.stem[:10]}").first.click()
        page.get_by_text("still being recorded").wait_for()
        wait_for_plots(page, "way-review")

        page.get_by_role("link", name="Runs", exact=True).click()
        compare = page.get_by_role("button", name="Compare")
        wait_until(compare.is_disabled, "nothing is chosen to compare")
        wait_until(lambda: page.evaluate(PAINTED), "the page's first picture")
        for run in (live.stem, recorded.stem):
            box = page.locator(f"input[value='{run}']")
            press_until(box, "Space", page.locator(f"input[value='{run}']:checked"), SEEN)
        picture(page, "way-runs")
        heading = page.get_by_role("heading", name="Comparison")
        press_until(compare, "Enter", heading, PATIENCE)
        wait_for_plots(page, "way-compare")

        # From here on nobody looks at the viewer, which would take all of a machine without a graphics card.
        page.route("**/viewer/**", lambda route: route.abort())
        page.get_by_role("link", name="paper", exact=True).last.click()
        page.locator("summary", has_text="Export").click()
        page.locator("select[name=format]").select_option("parquet")
        picture(page, "way-export")
        with page.expect_download(timeout=MILLI * PATIENCE) as download:
            page.locator("form[action$=export] button").click()
        file = front_server.settings.logs.parent / download.value.suggested_filename
        download.value.save_as(file)

        page.get_by_role("link", name="Runs", exact=True).click()
        page.locator("summary", has_text="Import").click()
        page.locator("input[type=file]").set_input_files(file)
        page.locator("form#import button").click()
        page.wait_for_url(f"**/runs/{recorded.stem}-2", timeout=MILLI * PATIENCE)
        found, original = (
            read_recording(front_server.settings.logs / f"{recorded.stem}-2.rrd"),
            read_recording(recorded),
        )
        for name, signal in vars(original.samples).items():
            assert getattr(found.samples, name).tobytes() == signal.tobytes(), name

        page.get_by_role("button", name="Replay").click()
        page.get_by_text("came out again, bit for bit").wait_for(timeout=MILLI * PATIENCE)
        page.locator("summary", has_text="Continue").click()
        page.locator("input[name=time]").fill("0.3")
        page.get_by_role("button", name="Continue from here").click()
        page.wait_for_url("**/lab/", timeout=MILLI * PATIENCE)
        run = wait_until(
            lambda: (path := place.status().recording) != live and path and path.stat().st_size and path,
            "the run that goes on is recorded",
        )
        page.get_by_role("button", name="Play from t = 0.3 s").click(timeout=MILLI * PATIENCE)
        wait_until(lambda: place.status().time > 0.5, "it goes on")
    front_server.close()
    assert read_recording(run).samples.time[0] == 0.3


def test_the_link_in_the_panel_opens_the_scenario_for_another_visitor(
    plain_chromium: Browser, open_another: Callable[..., FrontServer]
):
    front_server = open_another(private=True)
    with window(plain_chromium, f"{front_server.url}lab/soft-beam?fixedDpr=0.5") as page:
        page.wait_for_function(SCENE, timeout=MILLI * PATIENCE)
        page.get_by_text("File", exact=True).first.click()
        link = page.locator(".fl-code").first.text_content()
    assert link is not None
    assert link.startswith(f"{front_server.url}lab/?scenario=")
    ben = Person(front_server, "")
    ben.enter(link.removeprefix(front_server.url.rstrip("/")))
    wait_until(lambda: ben.place.status().title == load_preset("soft-beam").title, "another lab shows the scenario")
    assert len(front_server.places.running()) == 2
