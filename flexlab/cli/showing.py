"""Functions for commands that show a page until the person ends them."""

import json
import os
import signal
import sys
import threading
import webbrowser
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from flexlab.assets import web_assets_folder
from flexlab.cli.console import output
from flexlab.files import filled
from flexlab.interrupts import answering
from flexlab.sockets import listen, serving_pages

LOOK = 0.5
"""Interval of the checks for the end, s: on Windows, Ctrl-C cannot interrupt an endless wait."""


def open_browser(url: str) -> None:
    """Show a page in the person's browser, if this machine has a screen."""
    screen = sys.platform in ("win32", "darwin") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    # Without a screen, a text browser would take over this terminal.
    if screen or os.environ.get("BROWSER"):
        webbrowser.open(url)


@contextmanager
def ending() -> Generator[threading.Event, None, None]:
    """An event that the signals set, so that recordings are closed before the end; a second Ctrl-C ends at once.

    A closed terminal does not end what was started with nohup.
    """
    ended = threading.Event()

    def answer(number: int, _: object) -> None:
        if ended.is_set() and number == signal.SIGINT:
            os._exit(128 + number)  # Recordings are valid up to this instant.
        ended.set()

    with answering(answer, signal.SIGINT):
        yield ended


def show_review(path: Path, what: str, browser: bool, port: int) -> None:
    """Serve a recording to rerun's viewer, print its address and optionally open a browser, until the person ends it."""
    from flexlab.recording.viewer import review

    with ending() as ended, review(path, port) as address:
        console = output()
        console.print(f"{what} is open at", soft_wrap=True)
        console.print(address, style="bold", soft_wrap=True)
        console.print("Ctrl-C ends the viewer's server.")
        if browser:
            open_browser(address)
        wait_for(ended)


def wait_for(ended: threading.Event) -> None:
    """Return when the person ends the command."""
    while not ended.wait(LOOK):
        pass


SENTENCES = (
    "flexlab is compiling the equations of motion.",
    "This happens once for this version on this machine and usually takes less than half a minute.",
    "The lab will open here by itself.",
)


def _page() -> str:
    """The waiting page, with its sentences in every language."""
    catalogues: dict[str, dict[str, str]] = {}
    for file in (web_assets_folder() / "languages").glob("*.json"):
        known = json.loads(file.read_text(encoding="utf-8"))
        catalogues[file.stem] = {sentence: known[sentence] for sentence in SENTENCES if sentence in known}
    return filled(Path(__file__).with_name("waiting.html"), sentences=SENTENCES, catalogues=catalogues)


@contextmanager
def waiting_page(host: str, port: int) -> Generator[None]:
    """Serve a waiting page at the lab's address, and free the address afterwards. Raises `LabError` if it is in use."""
    headers = {"Content-Type": "text/html; charset=utf-8", "Retry-After": "1"}
    # 503 tells programs that the lab is not ready.
    with serving_pages(listen(host, port), lambda _host, _path: (503, headers, _page().encode())):
        yield
