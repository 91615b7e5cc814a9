"""Opens recordings in rerun's viewer, in the browser: served piece by piece, so that an hour opens as fast as a minute.

The viewer is packed inside rerun's own program. It is unpacked once, by asking that program to serve it, and then served
by flexlab with a content security policy: without one, it would fetch fonts, look for updates and report its use.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote, urlsplit

from flexlab.errors import RecordingError
from flexlab.recording.overlay import is_comparison
from flexlab.recording.reader import read_scenario
from flexlab.recording.repair import check_foreign, finish
from flexlab.recording.rerun_internals.tool import VIEWER_FILES, serving, viewer_folder
from flexlab.sockets import LOOPBACK, Answer, base_address, listen, name_in, serving_pages

SECURITY_POLICY = (
    "default-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' data: blob:; connect-src 'self' {source} data: blob:"
)
"""The viewer may talk to this server and to the one of its recording."""


@contextlib.contextmanager
def serving_viewer(port: int = 0, source: str = "") -> Iterator[str]:
    """Serve the web viewer on one port of this machine, 0 for a free one; yields its address.

    `source`: the server that recordings may come from, besides this one. Raises `LabError` if the port is in use, and
    `RecordingError` if the viewer is missing.
    """
    folder, policy = viewer_folder(), SECURITY_POLICY.format(source=source)

    def answer(host: str, path: str) -> Answer:
        name = path.partition("?")[0].lstrip("/") or "index.html"
        if name_in(host) not in LOOPBACK:
            return 403, {}, b""  # A foreign name that leads here would make a foreign page look like this one.
        if name not in VIEWER_FILES:
            return 404, {}, b""
        headers = {
            "Content-Type": VIEWER_FILES[name],
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
        }
        return 200, headers, (folder / name).read_bytes()

    plug = listen(LOOPBACK[0], port)
    with serving_pages(plug, answer):
        yield base_address(*plug.getsockname()) + "/"


@contextlib.contextmanager
def review(path: Path, port: int = 0) -> Iterator[str]:
    """Serve a recording, or a comparison of some, to this machine's browser; yields the address to open.

    A recording that its writer left without an end is mended first. `port` of the viewer, 0 for a free one. Raises
    `RecordingError` if there is nothing that can be read, and `LabError` for a port that is in use.
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
