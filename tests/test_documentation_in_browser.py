"""The documentation in a real browser: it fits a phone, and its theme can be switched by keyboard."""

import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from browser_window import open_window
from playwright.sync_api import Browser
from test_documentation import site as site

WIDER = "document.documentElement.scrollWidth > innerWidth"


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    """Address of the site on a server: browsers block the search of pages that are opened from a folder."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(SimpleHTTPRequestHandler, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def test_the_site_fits_a_phone_and_turns_dark_by_keyboard(plain_chromium: Browser, site: Path, address: str) -> None:
    window = open_window(plain_chromium, 390, 844, color_scheme="light", base_url=address)
    page, errors = window.new_page(), []
    page.on("pageerror", lambda error: errors.append(str(error)))
    wide: list[str] = []
    for file in sorted(site.rglob("*.html")):
        if file.name != "404.html":  # No hook of the site handles this page.
            page.goto(f"/{file.relative_to(site).as_posix()}")
            wide += [file.name] if page.evaluate(WIDER) else []
    assert wide == []
    page.set_viewport_size({"width": 1280, "height": 800})
    page.goto("/index.html")
    page.get_by_role("button", name="Toggle theme").press("Enter")
    page.get_by_role("button", name="Dark").press("Enter")
    page.locator("html[data-bs-theme=dark]").wait_for()
    assert sorted(set(errors)) == []
    window.close()
