"""Opens recordings in rerun's viewer, in the browser: served piece by piece, so that an hour opens as fast as a minute.

The viewer is packed inside rerun's own program. It is unpacked once, by asking that program to serve it, and then served
by flexlab with a content security policy: without one, it would fetch fonts, look for updates and report its use.
"""

import contextlib
import http.server
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote, urlsplit

from flexlab.errors import RecordingError
from flexlab.recording.overlay import is_comparison
from flexlab.recording.reader import read_scenario
from flexlab.recording.repair import check_foreign, finish
from flexlab.recording.rerun_internals.tool import VIEWER_FILES, serving, viewer_folder
from flexlab.sockets import LOOPBACK, name_in

SECURITY_POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; connect-src 'self' {source} data: blob:"
)
"""The viewer may talk to this server and to the one of its recording."""


@contextlib.contextmanager
def serving_viewer(port: int = 0, source: str = "") -> Iterator[str]:
    """Serve the web viewer on one port of this machine, 0 for a free one; yields its address.

    `source`: the server that recordings may come from, besides this one. Raises `RecordingError` if the port is in use or the
    viewer is missing.
    """
    folder = viewer_folder()

    class Handler(_Handler):
        root, policy = folder, SECURITY_POLICY.format(source=source)

    try:
        server = http.server.ThreadingHTTPServer((LOOPBACK[0], port), Handler)
    except (OSError, OverflowError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise RecordingError(
            f"The viewer cannot be served on {LOOPBACK[0]}:{port} ({reason}): choose another port, or 0 for any."
        ) from None
    with server:
        thread = threading.Thread(target=server.serve_forever, name="rerun-viewer", daemon=True)
        thread.start()
        try:
            yield f"http://{LOOPBACK[0]}:{server.server_port}/"
        finally:
            server.shutdown()
            thread.join()


class _Handler(http.server.BaseHTTPRequestHandler):
    """Answers with the viewer's files and nothing else."""

    root: Path
    policy: str
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        if name_in(self.headers.get("Host", "")) not in LOOPBACK:
            self.send_error(403)  # A foreign name that leads here would make a foreign page look like this one.
            return
        name = self.path.partition("?")[0].lstrip("/") or "index.html"
        if name not in VIEWER_FILES:
            self.send_error(404)
            return
        data = (self.root / name).read_bytes()
        self.send_response(200)
        self.send_header("Content-Type", VIEWER_FILES[name])
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Content-Security-Policy", self.policy)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        with contextlib.suppress(ConnectionError):
            self.wfile.write(data)

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing: a list of requests does not belong in a person's terminal."""


@contextlib.contextmanager
def review(path: Path, port: int = 0) -> Iterator[str]:
    """Serve a recording, or a comparison of some, to this machine's browser; yields the address to open.

    A recording that its writer left without an end is mended first. `port` of the viewer, 0 for a free one. Raises
    `RecordingError` if there is nothing that can be read.
    """
    check_foreign(path)
    finish(path)
    with contextlib.ExitStack() as closing:
        try:
            if not is_comparison(path):
                read_scenario(path)  # Refuses what another program wrote.
            source = closing.enter_context(serving(path))
        except (RuntimeError, ValueError, OSError, LookupError) as error:
            reason = str(error).split("\n")[0]
            raise RecordingError(f"{path} cannot be served to the viewer: {reason}") from None
        page = closing.enter_context(serving_viewer(port, f"http://{urlsplit(source).netloc}"))
        yield f"{page}?url={quote(source, safe='')}&hide_welcome_screen&renderer=webgl"
