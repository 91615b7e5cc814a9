"""A page whose connection to the lab is held up says how old its picture is, in a real browser."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from browser_window import open_window
from lab_page import READY
from playwright.sync_api import Browser

from flexlab.lab.session import Session

PIECE = 65536
"""Most bytes that are passed on at once."""


@contextmanager
def line_to(port: int) -> Iterator[tuple[int, threading.Event]]:
    """Open another port that leads to `port` of this machine; nothing comes from there while the event is not set."""
    flows = threading.Event()
    flows.set()
    door = socket.create_server(("127.0.0.1", 0))

    def carry(source: socket.socket, target: socket.socket, held: bool) -> None:
        try:
            while piece := source.recv(PIECE):
                if held:
                    flows.wait()
                target.sendall(piece)
        except OSError:
            pass
        finally:
            target.close()

    def admit() -> None:
        while True:
            try:
                near, _ = door.accept()
            except OSError:
                return
            far = socket.create_connection(("127.0.0.1", port))
            threading.Thread(target=carry, args=(near, far, False), daemon=True).start()
            threading.Thread(target=carry, args=(far, near, True), daemon=True).start()

    threading.Thread(target=admit, daemon=True).start()
    try:
        yield door.getsockname()[1], flows
    finally:
        flows.set()
        door.close()


def test_a_page_shows_the_age_of_its_picture_while_its_line_is_held_up(chromium: Browser, session: Session) -> None:
    with line_to(session.port) as (port, flows), open_window(chromium, 1440, 900) as window:
        page = window.new_page()
        page.goto(f"http://127.0.0.1:{port}/?fixedDpr=0.3")
        page.wait_for_function(READY)
        word = page.locator(".fl-behind")
        word.wait_for(state="hidden")
        flows.clear()
        word.filter(has_text="s old: the connection to the lab is slow or lost.").wait_for(state="visible")
        flows.set()
        word.wait_for(state="hidden")
