"""Rerun's web viewer, served from this machine and kept from calling anybody else.

The viewer lies packed inside rerun's own program. It is unpacked once, by asking that program to serve it, and then served
by flexlab with a content security policy: left alone, it would fetch fonts, look for updates and report its use.
"""

import contextlib
import http.server
import os
import re
import subprocess
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path
from urllib.parse import quote

import rerun as rr

from flexlab.errors import RecordingError
from flexlab.recording.repair import rerun_tool
from flexlab.recording.store.run_files import replacing
from flexlab.sockets import free_ports

VIEWER_FILES = {
    "index.html": "text/html; charset=utf-8",
    "re_viewer.js": "text/javascript",
    "re_viewer_bg.wasm": "application/wasm",
}
"""All that the viewer is made of, with its content types."""

SECURITY_POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; "
    "connect-src 'self' http://127.0.0.1:* data: blob:"
)
"""The viewer may talk to this machine and to nobody else."""

_FOREIGN_LINK = re.compile(rb"<link\b[^>]*\bhref=\"(?:https?:|favicon|apple)[^>]*>")
"""Fonts from outside, which the policy would refuse, and icons that are not there."""

LOOPBACK = "127.0.0.1"
UNPACK_TIME = 20.0
"""s that rerun's program may take to serve its viewer."""


def viewer_folder() -> Path:
    """A folder with the files of `VIEWER_FILES`, unpacked on first use. Raises `RecordingError` if that fails."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    folder = base / "flexlab" / f"rerun-{rr.__version__}"
    if not all((folder / name).is_file() for name in VIEWER_FILES):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _unpack(folder)
        except OSError as error:
            raise RecordingError(f"Rerun's web viewer cannot be unpacked into {folder}: {error}.") from None
    return folder


def _unpack(folder: Path) -> None:
    grpc, web = free_ports(2)
    options = ["--bind", LOOPBACK, "--port", str(grpc), "--web-viewer-port", str(web)]
    nothing = subprocess.DEVNULL
    process = subprocess.Popen([rerun_tool(), "--serve-web", *options], stdin=nothing, stdout=nothing, stderr=nothing)
    try:
        for name in VIEWER_FILES:
            data = _fetch(f"http://{LOOPBACK}:{web}/{name}", process)
            data = _FOREIGN_LINK.sub(b"", data) if name == "index.html" else data
            with replacing(folder / name) as draft:
                draft.write_bytes(data)
    finally:
        process.kill()
        process.wait()


def _fetch(address: str, process: "subprocess.Popen[bytes]") -> bytes:
    deadline = time.monotonic() + UNPACK_TIME
    while time.monotonic() < deadline and process.poll() is None:
        with contextlib.suppress(urllib.error.URLError, ConnectionError), urllib.request.urlopen(address) as answer:
            return answer.read()
        time.sleep(0.05)
    raise RecordingError("Rerun's program does not serve its web viewer: install rerun-sdk again.")


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
