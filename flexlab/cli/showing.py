"""What the commands share that show a page until the person ends them."""

import os
import signal
import sys
import threading
import webbrowser
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from flexlab.cli.console import output

LOOK = 0.5
"""s between two looks at whether to end: on Windows, Ctrl-C cannot interrupt a wait without end."""

SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP")
"""Ctrl-C, a polite kill, a closed terminal."""


def open_browser(url: str) -> None:
    """Show a page in the person's browser, if this machine has a screen."""
    screen = sys.platform in ("win32", "darwin") or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    # Without a screen, a browser for terminals would take this one over.
    if screen or os.environ.get("BROWSER"):
        webbrowser.open(url)


@contextmanager
def ending() -> Generator[threading.Event, None, None]:
    """An event that the signals set instead of killing, so that recordings are closed; a second Ctrl-C ends at once."""
    ended = threading.Event()
    numbers = [getattr(signal, name) for name in SIGNALS if hasattr(signal, name)]

    def answer(number: int, _: object) -> None:
        if ended.is_set() and number == signal.SIGINT:
            os._exit(128 + number)  # Whoever asks twice does not want to wait; recordings are whole up to here.
        ended.set()

    before = {number: signal.signal(number, answer) for number in numbers}
    try:
        yield ended
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def show_review(path: Path, what: str, browser: bool, port: int) -> None:
    """Serve a recording to rerun's viewer, say where, open a browser on it if wished, until the person ends it."""
    from flexlab.recording.viewer import open_review

    with ending() as ended, open_review(path, port) as review:
        console = output()
        console.print(f"{what} is open at", soft_wrap=True)
        console.print(review.url, style="bold", soft_wrap=True)
        console.print("Ctrl-C ends the viewer's server.")
        if browser:
            open_browser(review.url)
        wait_for(ended)


def wait_for(ended: threading.Event) -> None:
    """Return when the person ends the command."""
    while not ended.wait(LOOK):
        pass
