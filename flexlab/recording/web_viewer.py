"""Rerun's web viewer, served from this machine and kept from calling anybody else.

The viewer lies packed inside rerun's own program. It is unpacked once, by asking that program to serve it, and then served
by flexlab with a content security policy: left alone, it would fetch fonts, look for updates and report its use.
"""

import contextlib
import http.server
import threading
from pathlib import Path
from urllib.parse import quote, urlsplit

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.viewer_files import VIEWER_FILES, viewer_folder
from flexlab.sockets import LOOPBACK as LOOPBACK_NAMES

SECURITY_POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; "
    "connect-src 'self' http://127.0.0.1:* data: blob:"
)
"""The viewer may talk to this machine and to nobody else."""

LOOPBACK = "127.0.0.1"


def viewer_link(page: str, source: str) -> str:
    """The address of the viewer at `page` (http://host:port/) that opens `source` (a rerun or http address)."""
    return f"{page}?url={quote(source, safe='')}&hide_welcome_screen&renderer=webgl"


class ViewerServer:
    """Serves the web viewer on one port of this machine until `close`."""

    def __init__(self, host: str = LOOPBACK, port: int = 0):
        """Start; port 0 takes a free one. Raises `RecordingError` if the port is in use or the viewer is missing."""
        folder = viewer_folder()

        class Handler(_Handler):
            root = folder

        try:
            self._server = http.server.ThreadingHTTPServer((host, port), Handler)
        except (OSError, OverflowError) as error:
            reason = error.strerror if isinstance(error, OSError) else str(error)
            raise RecordingError(
                f"The viewer cannot be served on {host}:{port} ({reason}): choose another port, or 0 for any."
            ) from None
        self._thread = threading.Thread(target=self._server.serve_forever, name="rerun-viewer", daemon=True)
        self._thread.start()

    @property
    def page(self) -> str:
        """The address of the viewer."""
        host, port = self._server.server_address[:2]
        return f"http://{host!s}:{port}/"

    def close(self) -> None:
        """Stop serving."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Handler(http.server.BaseHTTPRequestHandler):
    """Answers with the viewer's files and nothing else."""

    root: Path
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        if urlsplit(f"//{self.headers.get('Host', '')}").hostname not in LOOPBACK_NAMES:
            self.send_error(403)  # A foreign name that leads here makes a foreign page look like this one.
            return
        name = self.path.partition("?")[0].lstrip("/") or "index.html"
        if name not in VIEWER_FILES:
            self.send_error(404)
            return
        data = (self.root / name).read_bytes()
        self.send_response(200)
        self.send_header("Content-Type", VIEWER_FILES[name])
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Content-Security-Policy", SECURITY_POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.end_headers()
        with contextlib.suppress(ConnectionError):
            self.wfile.write(data)

    def log_message(self, format: str, *args: object) -> None:
        """Quiet: a person's terminal is no place for a list of requests."""
