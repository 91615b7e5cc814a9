"""The documentation site builds without a warning, lists all that a user can name, and loads nothing from other servers.

In a real browser it fits a phone, and its theme can be switched by keyboard. One file, as the site takes long to build.
"""

import html
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from browser_window import open_window
from playwright.sync_api import Browser

import flexlab
from flexlab import cli
from flexlab.analysis.metrics.metric import number_names
from flexlab.control.law import laws
from flexlab.control.path import paths
from flexlab.guide import chapters
from flexlab.notation import SYMBOLS
from flexlab.scenario import Scenario
from flexlab.scenario.validation_errors import value_paths
from flexlab.sim.signals import known_signals

WIDER = "document.documentElement.scrollWidth > innerWidth"


@pytest.fixture(scope="module")
def site(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole site, built as CONTRIBUTING says."""
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "mkdocs",
        "build",
        "--quiet",
        "-f",
        "web_assets/docs/mkdocs.yml",
        "-d",
        str(folder),
    ]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return folder


def text_of(site: Path, page: str) -> str:
    """Return the text of a page without its tags."""
    return html.unescape(re.sub(r"<[^>]+>", "", (site / f"{page}.html").read_text(encoding="utf-8")))


def headings(site: Path, page: str) -> set[str]:
    found = re.findall(r"<h2[^>]*>(.*?)</h2>", (site / f"{page}.html").read_text(encoding="utf-8"), re.DOTALL)
    return {html.unescape(re.sub(r"<[^>]+>", "", each)).replace("¶", "").split()[0] for each in found}


def test_the_site_lists_all_that_a_user_can_name(site: Path):
    assert headings(site, "laws") == set(laws())
    assert headings(site, "paths") >= set(paths())
    assert headings(site, "commands") == set(cli.COMMANDS)
    assert headings(site, "python") == set(flexlab.__all__) - {"__version__"}
    for page, names in {
        "fields": value_paths(Scenario()),
        "signals": known_signals(),
        "metrics": number_names(),
        "symbols": (symbol.word for symbol in SYMBOLS),
    }.items():
        shown = text_of(site, page)
        assert [name for name in names if name not in shown] == []
    for chapter in chapters():
        assert chapter.title in text_of(site, f"guide/{chapter.id}")


def test_the_site_explains_the_options_of_commands(site: Path):
    shown = text_of(site, "commands")
    for words in ("--sample-period S", "Time between samples, s.", "--set PATH=VALUE", "RUN"):
        assert words in shown


def test_no_page_loads_anything_from_another_server(site: Path):
    for page in site.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        asked = re.findall(r'<(?:script|link|img|iframe)[^>]+(?:src|href)="(https?:[^"]+)"', text)
        assert [address for address in asked if "canonical" not in address] == [], page.name


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
