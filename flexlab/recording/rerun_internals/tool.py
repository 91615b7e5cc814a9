"""Rerun's own program, which comes with its Python package: it makes recordings whole, serves them, and holds the viewer."""

import contextlib
import os
import re
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import rerun as rr
import rerun_cli
from rerun.catalog import DatasetEntry
from rerun_bindings import CatalogClientInternal

from flexlab.assets import user_cache
from flexlab.errors import RecordingError
from flexlab.files import replacing
from flexlab.machine import limit_memory
from flexlab.recording.rerun_internals.chunks import quiet_reader
from flexlab.recording.rerun_internals.rrd_file import has_footer
from flexlab.sockets import LOOPBACK, free_ports, hidden_loopback
from flexlab.text import visible

LARGE_FILE = 500_000_000
"""Size above which pieces are indexed but not joined, bytes: joining reads the whole recording into memory."""
LOW_PRIORITY = 19
"""Unix niceness: a running lab must not notice."""
LONGEST = 600.0
"""Longest time for mending one file, s."""
MOST_MEMORY = 4_000_000_000
"""Memory that the tool may take, bytes: a damaged file may ask for any size."""
OS_ERROR = re.compile(r"([^:\n]*) \(os error (\d+)\)")
"""The tool's message about an error of the operating system."""
WARNINGS = "warn,re_analytics=off"
"""What the tool reports: its warnings, but not that it cannot keep its settings in a home folder that cannot be written."""


def rerun_tool() -> str:
    """The path of rerun's own program, which comes with its Python package. Raises `RecordingError`."""
    folder = Path(rerun_cli.__path__[0])
    for name in ("rerun", "rerun.exe", "Rerun.app/Contents/MacOS/Rerun"):
        if (folder / name).is_file():
            return str(folder / name)
    raise RecordingError(f"Rerun's program is not in {folder}: install rerun-sdk again.")


def _argument(path: Path) -> str:
    """A path for the tool, which takes one that begins with a dash for an option."""
    return os.path.join(os.curdir, path)


class Mending:
    """One run of rerun's tool on one file, which another thread may stop."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self.stopped = False
        """Whether `stop` was called."""

    def stop(self) -> None:
        """End the run of the tool now; the file stays as it was."""
        self.stopped = True
        process = self._process
        if process is not None:
            with contextlib.suppress(OSError):
                process.terminate()

    def rewrite(self, source: Path, target: Path, join: bool = True) -> bool:
        """Write what is readable of `source` to `target`, with a footer, and return whether anything is. `join`: small pieces.

        Raises OSError if the disk refuses; `target` is then useless, even if it can be read.
        """
        ways = ("optimize", "filter") if join and source.stat().st_size <= LARGE_FILE else ("filter",)
        return any(not self.stopped and self._run(way, source, target) for way in ways)

    def _run(self, way: str, source: Path, target: Path) -> bool:
        command = [rerun_tool(), "rrd", way, "--continue-on-error", _argument(source), "-o", _argument(target)]
        nothing, environment = subprocess.DEVNULL, os.environ | {"RUST_LOG": WARNINGS}
        # A session of its own: Ctrl-C is for the lab, which then waits for this or stops it.
        self._process = subprocess.Popen(
            command, stdin=nothing, stdout=nothing, stderr=subprocess.PIPE, env=environment, start_new_session=True
        )
        limit_memory(MOST_MEMORY, self._process.pid)
        with contextlib.suppress(OSError, AttributeError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, LOW_PRIORITY)
        if self.stopped:
            self._process.terminate()
        try:
            _, said = self._process.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            return False
        finally:  # Also after Ctrl-C: it would write on.
            self._process.kill()
            self._process.wait()
        # On a full disk the tool leaves a piece of the run and reports success; only its warnings tell.
        refused = OS_ERROR.search(said.decode(errors="replace"))
        if refused:
            raise OSError(int(refused[2]), refused[1].strip())
        return self._process.returncode == 0 and target.exists() and has_footer(target)


HARMLESS = (0, 1)
"""Exit codes of the tool after it has read a file, without and with remarks."""


def crashes_readers(path: Path) -> bool:
    """Whether rerun's reader crashes on a damaged file: its tool tries, as a crash would end this process."""
    command, nothing = [rerun_tool(), "rrd", "print", "-vv", _argument(path)], subprocess.DEVNULL
    with subprocess.Popen(command, stdin=nothing, stdout=subprocess.PIPE, stderr=nothing) as tried:
        limit_memory(MOST_MEMORY, tried.pid)
        try:
            said, _ = tried.communicate(timeout=LONGEST)
        except subprocess.TimeoutExpired:
            tried.kill()
            return True
    # The reader crashes on a name with a zero byte, which the tool prints.
    return tried.returncode not in HARMLESS or b"\0" in said


UNPACK_TIME = 20.0
"""Longest time until rerun's program serves its viewer, s."""
VIEWER_FILES = {
    "index.html": "text/html; charset=utf-8",
    "re_viewer.js": "text/javascript",
    "re_viewer_bg.wasm": "application/wasm",
}
"""All files of the viewer, with their content types."""
_FOREIGN_LINK = re.compile(rb"<link\b[^>]*\bhref=\"(?:https?:|favicon|apple)[^>]*>")
"""Links to outside fonts, which the policy would refuse, and to icons that are not there."""
OPTIONS = b"const options = {"
TELLING = b"""const options = {
          on_viewer_event: (event) => { if (window.parent !== window) window.parent.postMessage(event, location.origin); },"""
"""With this option the viewer tells the page around it where its time cursor goes."""
CHANGED = 1
"""Version of the changes to rerun's page: each version is unpacked into a folder of its own."""


def viewer_folder() -> Path:
    """A folder with the files of `VIEWER_FILES`, unpacked on first use. Raises `RecordingError` if that fails."""
    folder = user_cache() / "flexlab" / f"rerun-{rr.__version__}-{CHANGED}"
    if not all((folder / name).is_file() for name in VIEWER_FILES):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _unpack(folder)
        except OSError as error:
            raise RecordingError(
                f"Rerun's web viewer cannot be unpacked into {folder}: {error.strerror or error}."
            ) from None
    return folder


def _unpack(folder: Path) -> None:
    grpc, web = free_ports(2)
    options = ["--bind", LOOPBACK[0], "--port", str(grpc), "--web-viewer-port", str(web)]
    nothing = subprocess.DEVNULL
    process = subprocess.Popen([rerun_tool(), "--serve-web", *options], stdin=nothing, stdout=nothing, stderr=nothing)
    try:
        for name in VIEWER_FILES:
            data = _fetch(f"http://{LOOPBACK[0]}:{web}/{name}", process)
            if name == "index.html":
                data = _FOREIGN_LINK.sub(b"", data).replace(OPTIONS, TELLING, 1)
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


DATASET = "runs"


@contextlib.contextmanager
def serving(path: Path) -> Iterator[str]:
    """Serve a recording; yields the address that a viewer opens.

    Raises `RecordingError`, RuntimeError, ValueError, OSError or LookupError.
    """
    place = os.environ.get("TMPDIR", "")
    if place and not os.access(place, os.W_OK | os.X_OK):
        raise RecordingError(
            f"TMPDIR = {visible(place)} is not a folder that can be written, and rerun keeps its files there while it serves a "
            "recording: set TMPDIR to another folder, or unset it."
        )
    # The server answers whoever asks, under any name.
    server = rr.server.Server(host=hidden_loopback(), port=0, datasets={DATASET: [path]})
    try:
        # Rerun's public client needs a 43 MB library of queries for what follows, so its core is asked.
        (core,) = CatalogClientInternal(server.url()).datasets(False)
        # The server does not look for the layout inside the file. A run that is being recorded may break off within a message,
        # which it does not accept as a layout: the viewer then makes one of its own.
        with contextlib.suppress(ValueError):
            DatasetEntry(core).register_blueprint(path.resolve().as_uri())
        with quiet_reader(path) as reader:
            address = core.segment_url(reader.recordings()[0].recording_id)
        yield address
    finally:
        server.shutdown()
