"""Unpacks rerun's web viewer: it lies packed inside rerun's own program, which serves it once when asked to."""

import contextlib
import os
import re
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path

import rerun as rr

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.tool import rerun_tool
from flexlab.recording.store.notes import replacing
from flexlab.sockets import free_ports

LOOPBACK = "127.0.0.1"
UNPACK_TIME = 20.0
"""s that rerun's program may take to serve its viewer."""

VIEWER_FILES = {
    "index.html": "text/html; charset=utf-8",
    "re_viewer.js": "text/javascript",
    "re_viewer_bg.wasm": "application/wasm",
}
"""All that the viewer is made of, with its content types."""

_FOREIGN_LINK = re.compile(rb"<link\b[^>]*\bhref=\"(?:https?:|favicon|apple)[^>]*>")
"""Fonts from outside, which the policy would refuse, and icons that are not there."""


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
