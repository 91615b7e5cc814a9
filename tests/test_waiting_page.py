"""A first start shows a page at once, which turns into the lab when that is ready."""

import functools
import http.server
import threading
import urllib.error
import urllib.request
from pathlib import Path

import pytest
from playwright.sync_api import Browser

from flexlab.cli.waiting_page import WaitingPage


def test_programs_are_told_that_the_lab_is_not_there_yet():
    with WaitingPage("127.0.0.1", 0) as page, pytest.raises(urllib.error.HTTPError) as caught:
        urllib.request.urlopen(page.url + "/any/path")
    assert caught.value.code == 503
    assert "compiling the equations of motion" in caught.value.read().decode()


def test_the_port_is_free_again():
    with WaitingPage("127.0.0.1", 0) as page:
        port = int(page.url.rsplit(":", 1)[1])
    with WaitingPage("127.0.0.1", port):
        pass


def test_a_browser_turns_to_the_lab_by_itself(tmp_path: Path, chromium: Browser):
    (tmp_path / "index.html").write_text("<title>the lab</title>")
    tab = chromium.new_page()
    with WaitingPage("127.0.0.1", 0) as page:
        tab.goto(page.url)
        assert "compiling" in tab.inner_text("main")
    port = int(page.url.rsplit(":", 1)[1])
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", port), handler) as lab:
        threading.Thread(target=lab.serve_forever, args=(0.05,), daemon=True).start()
        tab.wait_for_function("document.title === 'the lab'")
        lab.shutdown()
    tab.close()
