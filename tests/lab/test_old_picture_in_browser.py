"""A page whose connection to the lab is held up or cut, in a real browser."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import NamedTuple

import pytest
from browser_window import open_window
from lab_page import READY
from playwright.sync_api import Browser, Page

from flexlab.lab.session import Session

PIECE = 65536
"""Most bytes that are passed on at once."""


@contextmanager
def line_to(port: int) -> Iterator[tuple[int, threading.Event, Callable[[], None]]]:
    """Open another port that leads to `port` of this machine; nothing comes from there while the event is not set.

    The function cuts all present connections.
    """
    open_ones: list[socket.socket] = []
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
            open_ones.append(near)
            threading.Thread(target=carry, args=(near, far, False), daemon=True).start()
            threading.Thread(target=carry, args=(far, near, True), daemon=True).start()

    def cut() -> None:
        for plug in open_ones:
            with suppress(OSError):
                plug.shutdown(socket.SHUT_RDWR)

    threading.Thread(target=admit, daemon=True).start()
    try:
        yield door.getsockname()[1], flows, cut
    finally:
        flows.set()
        door.close()


class HeldPage(NamedTuple):
    """A page of a lab and what becomes of its line: `flows` is not set while it is held up; `cut` cuts it."""

    page: Page
    flows: threading.Event
    cut: Callable[[], None]


@pytest.fixture(scope="module")
def held(chromium: Browser, shared_session: Session, few_pictures: None) -> Iterator[HeldPage]:
    """A page that never has the focus, as one on a projector, or beside the teacher's page."""
    with line_to(shared_session.port) as (port, flows, cut), open_window(chromium, 1440, 900) as window:
        page = window.new_page()
        page.add_init_script("Document.prototype.hasFocus = () => false")
        page.goto(f"http://127.0.0.1:{port}/?fixedDpr=0.3")
        page.wait_for_function(READY)
        yield HeldPage(page, flows, cut)


def test_a_page_shows_the_age_of_its_picture_while_its_line_is_held_up(held: HeldPage) -> None:
    word = held.page.locator(".fl-behind")
    word.wait_for(state="hidden")
    # As just after a connection, when the marks of the run have not come yet.
    held.page.evaluate("document.querySelector('.fl-run').remove()")
    held.page.locator(".fl-run").wait_for(state="attached")
    held.flows.clear()
    word.filter(has_text="s old: the connection to the lab is slow or lost.").wait_for(state="visible")
    held.flows.set()
    word.wait_for(state="hidden")


def test_a_page_without_the_focus_connects_again(held: HeldPage) -> None:
    """A lab on a projector stayed lost until somebody clicked on it."""
    way = held.page.locator(".fl-reports").get_attribute("data-way")
    held.cut()
    held.page.locator(f".fl-reports:not([data-way='{way}'])").wait_for(state="attached")
