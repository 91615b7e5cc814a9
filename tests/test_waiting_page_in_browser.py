"""The page of a first start turns into the lab by itself."""

import functools
import http.server
import threading
from pathlib import Path

from playwright.sync_api import Browser

from flexlab.cli.showing import waiting_page
from flexlab.sockets import free_ports


class Lab(http.server.SimpleHTTPRequestHandler):
    """Serves pages only to people who open them, as a lab does with the addresses of its presets."""

    def do_GET(self) -> None:
        if self.headers["Sec-Fetch-Dest"] == "document":
            super().do_GET()
        else:
            self.send_error(403)


def test_the_waiting_page_turns_into_the_lab_by_itself(tmp_path: Path, plain_chromium: Browser):
    (tmp_path / "index.html").write_text("<title>the lab</title>")
    tab = plain_chromium.new_page(locale="de-DE")
    [port] = free_ports(1)
    with waiting_page("127.0.0.1", port):
        tab.goto(f"http://127.0.0.1:{port}")
        assert "Bewegungsgleichungen" in tab.inner_text("main")
    handler = functools.partial(Lab, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", port), handler) as lab:
        threading.Thread(target=lab.serve_forever, args=(0.05,), daemon=True).start()
        tab.wait_for_function("document.title === 'the lab'")
        lab.shutdown()
    tab.close()
