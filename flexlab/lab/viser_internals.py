"""Every use of viser's private parts. `tests/lab/test_viser_contract.py` fails if viser has changed."""

import asyncio
import dataclasses
import functools
import gzip
import socket
import threading
from collections.abc import Awaitable, Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout, suppress
from io import StringIO
from typing import Any, Literal, cast

import viser
import websockets.asyncio.server
from viser import _messages
from viser.infra import _infra
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from flexlab.lab.browser_messages import LARGEST_MESSAGE
from flexlab.sockets import raise_handles

VERSION = "1.1"
"""The version of viser that this module is written for."""
SEND_BUFFER = 64 * 1024
"""Most bytes that wait in the operating system for one browser: without this bound a slow one shows pictures 36 s old."""
OPENING_TIME = 5.0
"""Longest time that a browser may take for the handshake, s."""
GOODBYE_TIME = 0.3
"""Time that browsers get for the closing handshake when the lab closes, s; viser alone waits six for one that hangs."""
MOST_WAITING = 4
"""Most messages of one browser that wait to be read."""

Admission = Callable[[Request], str]
"""Returns why a request is refused, as a sentence; empty if it is admitted."""
Verdict = Literal["pass", "drop", "hang up"]
Check = Callable[[int, Any], Awaitable[Verdict]]
"""(client id, raw message) → what to do with it. It may wait, which delays that browser only."""
UNREADABLE = 1011
"""Websocket close code for a client whose messages cannot be decoded."""
PROTOCOL = f"viser-v{viser.__version__}"
OTHER_VERSION = 1002
"""Websocket close code that tells viser's page that its version differs; the page then says so."""

_OPENING, _QUIET = threading.Lock(), threading.Lock()


class _News(asyncio.Event):
    """Event for new messages. viser sets it in the sending thread, and again in the event loop of the waiting tasks.

    It must not wake them in the sending thread: Python's own event would iterate over their list while the loop changes it.
    """

    _waiting_thread: int | None = None

    async def wait(self) -> Literal[True]:
        self._waiting_thread = threading.get_ident()
        return await super().wait()

    def set(self) -> None:
        """In the loop, wake all, even if another thread has set the flag; in another thread, only set the flag."""
        if threading.get_ident() == self._waiting_thread:
            self.clear()
            super().set()
        else:
            self._value = True


@dataclasses.dataclass
class _MessageBuffer(AsyncMessageBuffer):
    message_event: asyncio.Event = dataclasses.field(default_factory=_News)
    _warned_push_after_done: bool = True
    """viser then prints no warning about a message to a browser that has just left, as any may."""


cast(Any, _infra).AsyncMessageBuffer = _MessageBuffer


class GuardedServer(viser.ViserServer):
    """A viser server on a given socket that checks every request and message before viser sees it.

    It never opens viser's tunnel through an outside machine, whatever a browser requests.
    """

    def __init__(self, plug: socket.socket, admission: Admission, check: Check, script: str, sheet: str):
        """`script` and style `sheet` are added to the page."""
        raise_handles()  # Without enough handles viser's thread fails, and its server waits for it for ever.
        connection = functools.partial(_GuardedConnection, self, check)
        self.inputs = threading.RLock()
        """Held while a person's input is handled; other code that writes to widgets holds it too, see `_take_up_whole`."""
        # viser's page adds its own styles at the end of its head; styles after the body override them.
        added = {"</head>": f"<script>{script}</script>", "</body>": f"<style>{sheet}</style>"}
        with _serving_on(plug, admission, connection, added), _quiet():
            super().__init__(host="127.0.0.1", port=plug.getsockname()[1], label="flexlab", verbose=False)
        self._take_up_whole()
        self._acknowledge_to_the_sender()

    def _take_up_whole(self) -> None:
        """Keep other code from writing to a widget between a person's input and its callback: the input would be lost."""
        (take_up,) = self._websock_server._incoming_handlers[_messages.GuiUpdateMessage]

        async def alone(client: int, message: Any) -> None:
            # viser's handler and our callbacks never yield to another task, so the loop cannot deadlock on its own lock.
            with self.inputs:
                await cast(Awaitable[None], take_up(client, message))

        self._websock_server.unregister_handler(_messages.GuiUpdateMessage)
        self._websock_server.register_handler(_messages.GuiUpdateMessage, alone)

    def _acknowledge_to_the_sender(self) -> None:
        """Acknowledge an upload to its sender only: viser tells all browsers, and every later one."""
        server, broadcast = cast(Any, self._websock_server), self._websock_server.queue_message

        def queue(message: _messages.Message) -> None:
            if isinstance(message, _messages.FileTransferPartAck):
                _send_to(self, self.gui._current_file_upload_states[message.transfer_uuid]["client_id"], message)
            else:
                broadcast(message)

        server.queue_message = queue

    def stop(self) -> None:
        """Stop the server. Browsers get a closing message; one that does not read it is cut off."""
        loop = self._websock_server._background_event_loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(loop.call_later, GOODBYE_TIME, self._cut)
        with _quiet():
            super().stop()

    def _cut(self) -> None:
        for connection in list(self._websock_server._live_connections.values()):
            connection.transport.abort()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: always None."""
        return None


class _GuardedConnection(ServerConnection):
    """The connection that viser reads from, which passes on accepted messages only."""

    def __init__(self, owner: GuardedServer, check: Check, *arguments: Any, **options: Any):
        super().__init__(*arguments, **options)
        self._owner, self._check = owner, check

    async def recv(self, decode: bool | None = None) -> Any:
        while True:
            raw = await super().recv(decode)
            verdict = await self._check(client_of(self._owner, self), raw)
            if verdict == "pass":
                return raw
            if verdict == "hang up":
                await self.close(UNREADABLE, "This is not a message of the lab's page.")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep viser from printing its address and its end in the block: flexlab says so itself.

    All threads share the standard output: two that changed it at once would not restore it.
    """
    with _QUIET, redirect_stdout(StringIO()):
        yield


@contextmanager
def _serving_on(plug: socket.socket, admission: Admission, connection: Any, added: Mapping[str, str]) -> Iterator[None]:
    """Make a viser server that starts in the block listen on `plug` and answer only requests that `admission` accepts.

    viser itself opens a socket on the next free port and accepts everybody.
    """
    furnished = functools.partial(_with_additions, added=added, pages={})

    def serve(handler: Any, host: Any, port: Any, *, process_request: Any, **options: Any) -> Any:
        def look(at: ServerConnection, request: Request) -> Response | None:
            sentence = admission(request)
            return at.respond(403, f"{sentence}\n") if sentence else furnished(process_request(at, request))

        async def greet(at: ServerConnection) -> None:
            # viser itself writes a line of any length to the terminal, and fails if the version is long.
            if at.subprotocol == PROTOCOL:
                await handler(at)
            else:
                await at.close(OTHER_VERSION, "This page is of another version: load it again.")

        options |= {
            "create_connection": connection,
            "max_size": LARGEST_MESSAGE,
            "max_queue": MOST_WAITING,
            "open_timeout": OPENING_TIME,
        }
        return original(greet, sock=plug, process_request=look, **options)

    with _OPENING:
        original: Any = websockets.asyncio.server.serve
        websockets.asyncio.server.serve = serve
        try:
            yield
        finally:
            websockets.asyncio.server.serve = original


def _with_additions(answer: Response | None, added: Mapping[str, str], pages: dict[int, bytes]) -> Response | None:
    """A page with the parts `added`, each before the closing tag that is its key. `pages`: a cache of such pages, by length."""
    if answer is None or not answer.headers.get("Content-Type", "").startswith("text/html"):
        return answer
    packed, length = answer.headers.get("Content-Encoding") == "gzip", len(answer.body)
    if length not in pages:
        page = gzip.decompress(answer.body) if packed else answer.body
        for tag, part in added.items():
            before, mark, rest = page.rpartition(tag.encode())
            page = before + part.encode() + mark + rest
        pages[length] = gzip.compress(page) if packed else page
    answer.body = pages[length]
    del answer.headers["Content-Length"]
    answer.headers["Content-Length"] = str(len(answer.body))
    return answer


def widget_uuid(handle: Any) -> str:
    """The page's identifier of a widget or chart."""
    return handle._impl.uuid


def set_panel_width(client: viser.ClientHandle, panel: Any, width: float) -> None:
    """Set a shared panel's width, px, in one browser."""
    _lay_out(client, panel, _messages.GuiSetPanelWidthMessage, width)


def fold_panel(client: viser.ClientHandle, panel: viser.PanelHandle, folded: bool) -> None:
    """Fold a shared panel to its strip, or open it, in one browser."""
    _lay_out(client, panel, _messages.GuiSetPanelCollapsedMessage, folded)


def _lay_out(client: viser.ClientHandle, panel: Any, message: type, value: float) -> None:
    gui = client.gui
    told = message(panel._placement_uuid, value, gui._next_layout_counter(), gui._layout_run_id)
    gui._websock_interface.queue_message(told)


def tell_camera(client: viser.ClientHandle, position: Any, look_at: Any) -> None:
    """Send a camera's position and the point that it looks at, m, (3,) each, even if viser believes the browser to show them."""
    for message, place in (_messages.SetCameraPositionMessage, position), (_messages.SetCameraLookAtMessage, look_at):
        client._websock_connection.queue_message(message(tuple(map(float, place))))


def client_of(server: viser.ViserServer, connection: ServerConnection) -> int:
    """The id of the client with this connection; -1 once it is gone."""
    live = server._websock_server._live_connections
    return next((client for client, present in list(live.items()) if present is connection), -1)


def on_disconnect(server: viser.ViserServer, tell: Callable[[int], None]) -> None:
    """Call `tell` for every connection that ends, even if it never became a client."""

    async def gone(connection: Any) -> None:
        tell(connection.client_id)

    server._websock_server.on_client_disconnect(gone)


def bound_buffer(server: viser.ViserServer, client: viser.ClientHandle) -> None:
    """Limit what the operating system buffers for a browser: otherwise a slow one shows old pictures."""
    connection = server._websock_server._live_connections.get(client.client_id)
    bound_transport(getattr(connection, "transport", None))


def bound_transport(transport: asyncio.BaseTransport | None) -> None:
    """Limit what the operating system buffers for the other end of a connection."""
    plug = transport.get_extra_info("socket") if transport is not None else None
    if plug is not None:
        with suppress(OSError):  # The other end may be gone.
            plug.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)


def find_input(server: viser.ViserServer, client: int, uuid: str) -> Any:
    """The shared or own widget of a browser with this uuid; None if there is none or it takes no input."""
    for gui in _interfaces(server, client):
        handle = gui._gui_input_handle_from_uuid.get(uuid)
        if handle is not None and not handle._impl.removed:
            return handle
    return None


def is_command(server: viser.ViserServer, client: int, uuid: str) -> bool:
    """Whether there is a command (a key, or a line of the palette) with this uuid."""
    return any(uuid in gui._command_handle_from_uuid for gui in _interfaces(server, client))


def _interfaces(server: viser.ViserServer, client: int) -> list[Any]:
    own = server.get_clients().get(client)
    return [server.gui] if own is None else [server.gui, own.gui]


def input_state(handle: Any) -> tuple[str, Any, bool, Collection[str] | None]:
    """(label, value, whether it is a button, options of a menu or None) of a widget."""
    own, props = handle._impl, handle._impl.props
    return getattr(props, "label", "") or "this control", own.value, own.is_button, getattr(props, "options", None)


def show_true_value(handle: Any) -> None:
    """Send a widget's value again, to browsers that show another one, unless it has been removed."""
    if not handle._impl.removed:
        update = _messages.GuiUpdateMessage(handle._impl.uuid, {"value": handle._impl.value})
        handle._impl.gui_api._websock_interface.queue_message(update)


def scene_instances(server: viser.ViserServer, name: str) -> int | None:
    """Number of instances of a scene node: 0 if it is no batch, None if there is no such node."""
    handle = server.scene._handle_from_node_name.get(name)
    if handle is None:
        return None
    positions = getattr(handle._impl.props, "batched_positions", None)
    return 0 if positions is None else len(positions)


def end_upload(server: viser.ViserServer, client: int, transfer: str, button: str) -> None:
    """Let a browser's button for files go on after a refused upload."""
    _send_to(server, client, _messages.FileTransferPartAck(button, transfer, transferred_bytes=0, total_bytes=0))


def _send_to(server: viser.ViserServer, client: int, message: _messages.Message) -> None:
    to = server.get_clients().get(client)
    if to is not None:
        to._websock_connection.queue_message(message)


def send_plot_data(handle: viser.GuiUplotHandle, columns: tuple[Any, ...]) -> None:
    """Send new data to a chart without converting their type: viser's own setter takes eight bytes per number."""
    handle._impl.props.data = columns
    handle._queue_update("data", columns)


def mark_slider(handle: viser.GuiInputHandle[Any], marks: tuple[tuple[float, str], ...]) -> None:
    """Change the marks, (value, label) each, of an existing slider: viser takes them only when a slider is made."""
    shown = tuple(_messages.GuiSliderMark(value, label) for value, label in marks)
    handle._impl.props._marks = shown
    handle._queue_update("_marks", shown)


def in_the_systems_colors(page: str) -> str:
    """A serialized scene's HTML, made dark if the reader's system is: viser decides that when the file is written."""
    fixed = "window.__VISER_EMBED_CONFIG__={darkMode:false};"
    asked = "window.__VISER_EMBED_CONFIG__={darkMode:matchMedia('(prefers-color-scheme: dark)').matches};"
    head, found, rest = page.rpartition(fixed)
    return head + asked + rest if found else page
