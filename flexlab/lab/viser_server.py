"""The lab's viser server: on the requested port or not at all, with checks of every request and message of a browser.

viser writes whatever a browser sends into its own state, names of attributes included, keeps some of it for all later browsers,
and does both before any callback runs. So each raw message is checked first: its type, the type and range of every field,
whether what it names exists, and how much and how often one browser sends.
"""

import asyncio
import hmac
import logging
import math
import time
from collections.abc import Collection
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import viser
from websockets.http11 import Request

from flexlab.lab.browser_messages import (
    CommandTriggerMessage,
    FileTransferPart,
    FileTransferStartUpload,
    GuiButtonHoldMessage,
    GuiUpdateMessage,
    Heard,
    Refused,
    SceneNodeClickMessage,
    SceneNodeDragMessage,
    Unreadable,
    ViewerCameraMessage,
    decode,
)
from flexlab.lab.lab_state import LabState
from flexlab.lab.viser_internals import (
    GuardedServer,
    Verdict,
    bound_buffer,
    end_upload,
    find_input,
    input_state,
    is_command,
    on_disconnect,
    scene_instances,
    show_true_value,
    widget_uuid,
)
from flexlab.sockets import LOOPBACK, is_of_host, listen, name_in
from flexlab.text import limited

LONGEST_INPUT = 10_000
"""Most characters of a text that a browser may send into a widget."""
LARGEST_UPLOAD = 1_000_000
"""Largest file that a browser may send, bytes: a scenario has a few thousand."""
SMALLEST_PART = 100_000
"""Least size of a part of a file, bytes: the page cuts files into larger parts. It bounds the number of parts."""
MOST_UPLOADS = 4
"""Most incomplete uploads of one browser."""

RATE, BURST = 100.0, 300.0
"""Most messages of one browser per second, and at once: its page sends at most about 40 a second. Faster ones wait."""
BYTES_PER_MESSAGE = 10_000
"""Bytes that count as one message: a longer message counts as several."""
PRESS_COST = 10.0
"""Cost of a key, a button or a menu, in messages: 10 a second, and 30 at once, are more than a person presses."""

SETTLE_TIME = 4.0
"""Time after a person's last input into a control until all pages are sent its value again, wall s.

A refused value stays as long, to be corrected.
"""

SECRET_HEADER = "Flexlab-Proxy"
"""The request header by which a server in front of the lab identifies itself."""
LIBRARY_LOGS = ("websockets.server", "asyncio")
"""Logs of libraries that a visitor could flood."""

log: logging.Logger = limited(__name__)


@dataclass
class _Upload:
    source: str
    size: int
    part_count: int
    parts: set[int] = field(default_factory=set)
    received: int = 0


@dataclass
class _Browser:
    credit: float = BURST
    counted_at: float = field(default_factory=time.monotonic)
    refused: int = 0
    uploads: dict[str, _Upload] = field(default_factory=dict)
    """Incomplete uploads, by transfer."""

    def wait_for_turn(self, cost: float) -> float:
        """Seconds that a message of this cost must wait."""
        now = time.monotonic()
        self.credit = min(BURST, self.credit + RATE * (now - self.counted_at)) - cost
        self.counted_at = now
        return max(-self.credit / RATE, 0.0)


class InputGuard:
    """The check of one server's messages. For the server's event loop only."""

    def __init__(self) -> None:
        self._browsers: dict[int, _Browser] = {}
        self._server: GuardedServer | None = None
        self._lab_state: LabState | None = None
        self._settling: dict[str, asyncio.TimerHandle] = {}
        """When the values of controls are sent again, by control."""
        self.refused = 0
        """Messages refused so far, of all browsers."""

    def watch(self, server: GuardedServer, lab_state: LabState) -> None:
        """Begin to accept input; before this, only camera messages pass."""
        on_disconnect(server, self._forget)
        self._lab_state = lab_state
        self._server = server

    async def check(self, client: int, raw: Any) -> Verdict:
        """The verdict on a message. A browser that sends too much has to wait; the others do not."""
        browser = self._browsers.setdefault(client, _Browser())
        cost, problem = 1.0 + len(raw) / BYTES_PER_MESSAGE, None
        try:
            cost += self._possible(client, browser, decode(raw))
        except Refused as refused:
            problem = refused
        wait = browser.wait_for_turn(cost)
        if wait > 0.0:
            await asyncio.sleep(wait)
        if problem is None:
            return "pass"
        browser.refused += 1
        self.refused += 1
        if browser.refused == 1:
            log.warning("Refused a message of browser %s (further ones are counted): %s.", client, problem)
        if problem.told and self._lab_state is not None:
            self._lab_state.warn(problem.told)
        return "hang up" if isinstance(problem, Unreadable) else "drop"

    def silence(self, client: int) -> float:
        """Time since the newest message of a browser, s; infinite once it has left."""
        browser = self._browsers.get(client)
        return math.inf if browser is None else time.monotonic() - browser.counted_at

    def _forget(self, client: int) -> None:
        browser = self._browsers.pop(client, None)
        if browser is not None and browser.refused:
            log.warning("Refused %s messages of browser %s, which has left.", browser.refused, client)

    def _possible(self, client: int, browser: _Browser, message: Heard) -> float:
        """The message's cost besides its length. Raises `Refused` if it names what does not exist, or has an impossible value."""
        server = self._server
        if isinstance(message, ViewerCameraMessage):
            return 0.0
        if server is None:
            raise Refused("the lab is not open yet")
        if isinstance(message, GuiUpdateMessage):
            cost = _check_update(server, client, message)
            self._settle(server, message.uuid)
            return cost
        if isinstance(message, GuiButtonHoldMessage):
            handle = find_input(server, client, message.uuid)
            if handle is None or not input_state(handle)[2]:
                raise Refused("it holds a button that is not there")
        elif isinstance(message, CommandTriggerMessage):
            if not is_command(server, client, message.uuid):
                raise Refused("it names a command that is not there")
            return PRESS_COST
        elif isinstance(message, FileTransferStartUpload):
            self._start_upload(server, client, browser, message)
            return PRESS_COST
        elif isinstance(message, FileTransferPart):
            _take_part(browser, message)
        else:
            _check_touch(server, message)
        return 0.0

    def _settle(self, server: GuardedServer, uuid: str) -> None:
        """Send a shared control's value again once nobody uses it.

        Of two people who use it at once, the first may hear of the second's value after sending the one that counts.
        """
        handle = find_input(server, -1, uuid)
        if handle is not None and not input_state(handle)[2]:
            if uuid in self._settling:
                self._settling[uuid].cancel()
            self._settling[uuid] = asyncio.get_running_loop().call_later(SETTLE_TIME, self._show, handle)

    def _show(self, handle: Any) -> None:
        del self._settling[widget_uuid(handle)]
        show_true_value(handle)

    def _start_upload(
        self, server: GuardedServer, client: int, browser: _Browser, message: FileTransferStartUpload
    ) -> None:
        if not isinstance(find_input(server, client, message.source_component_uuid), viser.GuiUploadButtonHandle):
            raise Refused("it uploads to a button that is not there")
        if message.size_bytes > LARGEST_UPLOAD:
            end_upload(server, client, message.transfer_uuid, message.source_component_uuid)
            told = f"This file has {message.size_bytes} bytes, over {LARGEST_UPLOAD}: that is not a scenario file."
            raise Refused("its file is too large", told)
        if message.part_count > 1 + message.size_bytes // SMALLEST_PART:
            raise Refused("its file has more parts than bytes to fill them")
        if message.size_bytes > 0 and message.part_count == 0:
            raise Refused("its file has no parts that could hold its bytes")
        if any(message.transfer_uuid in other.uploads for other in self._browsers.values()):
            raise Refused("its transfer has begun already")
        if len(browser.uploads) >= MOST_UPLOADS:
            raise Refused("too many of its files are not complete")
        if message.part_count > 0:
            browser.uploads[message.transfer_uuid] = _Upload(
                message.source_component_uuid, message.size_bytes, message.part_count
            )


def _take_part(browser: _Browser, message: FileTransferPart) -> None:
    upload = browser.uploads.get(message.transfer_uuid)
    if upload is None or message.source_component_uuid != upload.source:
        raise Refused("it is a part of no file that was announced")
    if message.part_index in upload.parts or message.part_index >= upload.part_count:
        raise Refused("it is a part that was not announced, or came before")
    if upload.received + len(message.content) > upload.size:
        raise Refused("its parts have more bytes than the file was to have")
    received, is_last = upload.received + len(message.content), len(upload.parts) + 1 == upload.part_count
    if is_last and received < upload.size:
        told = f"This file did not arrive completely, {received} of {upload.size} bytes: choose it again."
        raise Refused("its parts have fewer bytes than the file was to have", told)
    upload.parts.add(message.part_index)
    upload.received = received
    if is_last:
        del browser.uploads[message.transfer_uuid]


def _check_touch(server: GuardedServer, message: SceneNodeClickMessage | SceneNodeDragMessage) -> None:
    instances = scene_instances(server, message.name)
    if instances is None:
        raise Refused("it touches what is not in the picture")
    if instances and (message.instance_index is None or message.instance_index >= instances):
        raise Refused("it touches an instance that is not in the picture")


def _check_update(server: GuardedServer, client: int, message: GuiUpdateMessage) -> float:
    handle = find_input(server, client, message.uuid)
    if handle is None:
        raise Refused("it changes a control that is not there")
    label, present, is_button, options = input_state(handle)
    problem = _problem(present, options, message.updates)
    if problem:
        if "value" in message.updates and not is_button:
            show_true_value(handle)
        raise Refused("its value cannot be meant", f"{label}: {problem} Nothing was changed.")
    return PRESS_COST if is_button or options is not None else 0.0


def _problem(present: Any, options: Collection[str] | None, updates: dict[str, Any]) -> str:
    """What is wrong with an update of a widget that has the value `present`, as a sentence; empty if it is valid."""
    if set(updates) != {"value"}:
        return "the browser sent something that is not a value."
    new = updates["value"]
    if isinstance(present, bool):  # A button has one too, but an upload button has a file.
        return "" if isinstance(new, bool) else "needs on or off."
    if isinstance(present, (int, float)):
        return _number_problem(new)
    if isinstance(present, tuple):
        if not isinstance(new, (list, tuple)) or len(new) != len(present):
            return f"needs {len(present)} numbers."
        return next(filter(None, map(_number_problem, new)), "")
    if isinstance(present, str):
        if not isinstance(new, str):
            return "needs a text."
        if len(new) > LONGEST_INPUT:
            return f"a text of {len(new)} characters is too long, at most {LONGEST_INPUT}."
        if options is not None and new not in options:
            return f"{new[:40]!r} is not one of its options: choose one from the menu."
        return ""
    return "cannot be changed from the browser."


def _number_problem(new: Any) -> str:
    if isinstance(new, bool) or not isinstance(new, (int, float)) or not math.isfinite(new):
        shown = "text" if isinstance(new, str) else "NaN or infinite" if isinstance(new, float) else "something else"
        return f"needs a finite number, not {shown}."
    return ""


def open_server(port: int, guard: InputGuard, secret: str = "", script: str = "", sheet: str = "") -> GuardedServer:
    """A running server on this machine's `port` (0 for any free one); raises `LabError` if that port is not available.

    With a `secret` it answers only requests that carry it; without one, only requests from its own page.
    `script` and style `sheet` are added to the page.
    """
    for name in LIBRARY_LOGS:
        limited(name)
    plug, admission = listen(LOOPBACK[0], port), partial(_knows, secret) if secret else _own_page
    try:
        server = GuardedServer(plug, admission, guard.check, script, sheet)
    except BaseException:
        plug.close()
        raise
    set_theme(server.gui, dark=False)

    async def bound(client: viser.ClientHandle) -> None:
        bound_buffer(server, client)

    server.on_client_connect(bound)
    return server


def set_theme(gui: viser.GuiApi, dark: bool) -> None:
    """Set the page's theme, for all browsers or for one."""
    gui.configure_theme(show_logo=False, show_share_button=False, dark_mode=dark)


def _knows(secret: str, request: Request) -> str:
    given = request.headers.get_all(SECRET_HEADER)
    if len(given) == 1 and hmac.compare_digest(given[0].encode("utf-8", "replace"), secret.encode()):
        return ""
    return "This is the inside of a lab: open it by the address that flexlab printed."


def _own_page(request: Request) -> str:
    """Refuse requests by another site's page through a visitor's browser, also under a name that resolves to this machine."""
    named = request.headers.get_all("Host")
    if len(named) != 1:
        return "This request names no host."
    if name_in(named[0]) not in LOOPBACK:
        return "This lab is open to this machine only: use 127.0.0.1."
    origins = request.headers.get_all("Origin")
    if not all(is_of_host(origin, named[0]) for origin in origins):
        return "This came from a page of another site."
    return ""
