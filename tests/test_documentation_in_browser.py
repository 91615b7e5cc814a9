"""The documentation in a real browser: it fits a phone, and its switch of light and dark works by keyboard."""

from pathlib import Path

from browser_window import open_window
from playwright.sync_api import Browser
from test_documentation import site as site

WIDER = "document.documentElement.scrollWidth > innerWidth"


def test_it_fits_a_phone_and_turns_dark_by_keyboard(plain_chromium: Browser, site: Path) -> None:
    window = open_window(plain_chromium, 390, 844, color_scheme="light")
    page, errors = window.new_page(), []
    page.on("pageerror", lambda error: errors.append(str(error)))
    wide: list[str] = []
    for file in sorted(site.rglob("*.html")):
        if file.name != "404.html":  # Its addresses are those of a server.
            page.goto(file.as_uri())
            wide += [file.name] if page.evaluate(WIDER) else []
    assert wide == []
    page.set_viewport_size({"width": 1280, "height": 800})
    page.goto((site / "index.html").as_uri())
    errors.clear()  # The theme's search needs a server.
    page.get_by_role("button", name="Toggle theme").press("Enter")
    page.get_by_role("button", name="Dark").press("Enter")
    page.locator("html[data-bs-theme=dark]").wait_for()
    assert errors == []
    window.close()
