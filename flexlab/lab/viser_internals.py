"""Every use of viser's private parts. `tests/lab/test_viser_contract.py` says when viser has changed."""

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
"""The version of viser that these belong to."""
SEND_BUFFER = 64 * 1024
"""Bytes that may wait in the kernel for one browser: without this bound a slow one shows pictures 36 s old."""
OPENING_TIME = 5.0
"""Seconds that a browser may take for the handshake."""
GOODBYE_TIME = 0.3
"""Seconds that browsers get to say goodbye when the lab closes; viser alone waits six for one that hangs."""
MOST_WAITING = 4
"""Messages of one browser that wait to be read."""

Admission = Callable[[Request], str]
"""Why a request is not let in, as a sentence; empty if it is."""
Verdict = Literal["pass", "drop", "hang up"]
Check = Callable[[int, Any], Awaitable[Verdict]]
"""(client id, raw message) → what becomes of it. May wait: then that one browser waits."""
UNREADABLE = 1011
"""Websocket close code for a client whose messages cannot be decoded."""
PROTOCOL = f"viser-v{viser.__version__}"
OTHER_VERSION = 1002
"""Websocket close code by which viser's page knows that it is of another version: it then says so."""

_OPENING, _QUIET = threading.Lock(), threading.Lock()


class _News(asyncio.Event):
    """Event for new messages. viser sets it in the sending thread, and again in the loop of those who wait.

    In the sending thread it must not wake them: Python's own event would iterate over their list while the loop changes it.
    """

    _waiting_thread: int | None = None

    async def wait(self) -> Literal[True]:
        self._waiting_thread = threading.get_ident()
        return await super().wait()

    def set(self) -> None:
        """In the loop wake all, even if another thread has set it before; in another thread only set the flag."""
        if threading.get_ident() == self._waiting_thread:
            self.clear()
            super().set()
        else:
            self._value = True


@dataclasses.dataclass
class _MessageBuffer(AsyncMessageBuffer):
    message_event: asyncio.Event = dataclasses.field(default_factory=_News)


cast(Any, _infra).AsyncMessageBuffer = _MessageBuffer


class GuardedServer(viser.ViserServer):
    """A viser server on a given socket that checks every request and message before viser sees it.

    It never opens viser's tunnel through an outside machine, whatever a browser asks.
    """

    def __init__(self, plug: socket.socket, admission: Admission, check: Check, script: str, sheet: str):
        """`script` and style `sheet` are added to the page."""
        raise_handles()  # Without enough of them viser's thread fails, and its server waits for it for ever.
        connection = functools.partial(_GuardedConnection, self, check)
        self.inputs = threading.RLock()
        """Held while a person's input is handled; other code that writes to widgets holds it too, see `_take_up_whole`."""
        # viser's page puts its own styles at the end of its head: what comes after the body has the last word.
        added = {"</head>": f"<script>{script}</script>", "</body>": f"<style>{sheet}</style>"}
        with _serving_on(plug, admission, connection, added), _quiet():
            super().__init__(host="127.0.0.1", port=plug.getsockname()[1], label="flexlab", verbose=False)
        self._take_up_whole()

    def _take_up_whole(self) -> None:
        """Let no other code write to a widget between a person's input and the callback that reads it: it would be lost."""
        (take_up,) = self._websock_server._incoming_handlers[_messages.GuiUpdateMessage]

        async def alone(client: int, message: Any) -> None:
            # viser's handler and our callbacks never give way to another task, so the loop cannot stop on its own lock.
            with self.inputs:
                await cast(Awaitable[None], take_up(client, message))

        self._websock_server.unregister_handler(_messages.GuiUpdateMessage)
        self._websock_server.register_handler(_messages.GuiUpdateMessage, alone)

    def stop(self) -> None:
        """Close the page. Browsers get a closing message; one that does not read it is cut off."""
        loop = self._websock_server._background_event_loop
        if loop is not None and not loop.is_closed():
            loop.call_soon_threadsafe(loop.call_later, GOODBYE_TIME, self._cut)
        with _quiet():
            super().stop()

    def _cut(self) -> None:
        for connection in list(self._websock_server._live_connections.values()):
            connection.transport.abort()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refused: always None."""
        return None


class _GuardedConnection(ServerConnection):
    """The connection that viser reads from: it passes on accepted messages only."""

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
                await self.close(UNREADABLE, "This is no message of the lab's page.")


@contextmanager
def _quiet() -> Iterator[None]:
    """While this is open, viser does not print where it serves and when it stops, which is flexlab's to say.

    All threads share the standard output: two that changed it at once would not put it back.
    """
    with _QUIET, redirect_stdout(StringIO()):
        yield


@contextmanager
def _serving_on(plug: socket.socket, admission: Admission, connection: Any, added: Mapping[str, str]) -> Iterator[None]:
    """While this is open, viser's server listens on `plug` and answers only requests that `admission` accepts.

    By itself viser opens a socket on the next free port, and accepts everybody.
    """
    furnished = functools.partial(_with_additions, added=added, pages={})

    def serve(handler: Any, host: Any, port: Any, *, process_request: Any, **options: Any) -> Any:
        def look(at: ServerConnection, request: Request) -> Response | None:
            sentence = admission(request)
            return at.respond(403, f"{sentence}\n") if sentence else furnished(process_request(at, request))

        async def greet(at: ServerConnection) -> None:
            # viser itself writes a line to the terminal, without end, and fails where the version is long.
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
        websockets.asyncio.server.serve = serve  # type: ignore[assignment, misc]  # A class there, a function here.
        try:
            yield
        finally:
            websockets.asyncio.server.serve = original


def _with_additions(answer: Response | None, added: Mapping[str, str], pages: dict[int, bytes]) -> Response | None:
    """A page with our parts, each before the closing tag that is its key. `pages`: those completed before, by length."""
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
    """Give a panel of all browsers a width, px, in one browser."""
    _lay_out(client, panel, _messages.GuiSetPanelWidthMessage, width)


def fold_panel(client: viser.ClientHandle, panel: viser.PanelHandle, folded: bool) -> None:
    """Fold a panel of all browsers to its strip, or open it, in one browser."""
    _lay_out(client, panel, _messages.GuiSetPanelCollapsedMessage, folded)


def _lay_out(client: viser.ClientHandle, panel: Any, message: type, value: float) -> None:
    gui = client.gui
    told = message(panel._placement_uuid, value, gui._next_layout_counter(), gui._layout_run_id)
    gui._websock_interface.queue_message(told)


def client_of(server: viser.ViserServer, connection: ServerConnection) -> int:
    """The client whose connection this is; -1 once it is gone."""
    live = server._websock_server._live_connections
    return next((client for client, present in list(live.items()) if present is connection), -1)


def on_disconnect(server: viser.ViserServer, tell: Callable[[int], None]) -> None:
    """Call `tell` for every connection that ends, also one that never became a client."""

    async def gone(connection: Any) -> None:
        tell(connection.client_id)

    server._websock_server.on_client_disconnect(gone)


def bound_buffer(server: viser.ViserServer, client: viser.ClientHandle) -> None:
    """Limit what the kernel buffers for a browser: else a slow one shows old pictures. viser gives no access to the socket."""
    connection = server._websock_server._live_connections.get(client.client_id)
    bound_transport(getattr(connection, "transport", None))


def bound_transport(transport: asyncio.BaseTransport | None) -> None:
    """Limit what the kernel buffers for who is at the other end."""
    plug = transport.get_extra_info("socket") if transport is not None else None
    if plug is not None:
        with suppress(OSError):  # They may have left meanwhile.
            plug.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)


def find_input(server: viser.ViserServer, client: int, uuid: str) -> Any:
    """The widget of this uuid, of all browsers or of one; None if there is none, or if it takes no input."""
    for gui in _interfaces(server, client):
        handle = gui._gui_input_handle_from_uuid.get(uuid)
        if handle is not None and not handle._impl.removed:
            return handle
    return None


def is_command(server: viser.ViserServer, client: int, uuid: str) -> bool:
    """Whether there is a command (a key, or a line of the palette) of this uuid."""
    return any(uuid in gui._command_handle_from_uuid for gui in _interfaces(server, client))


def _interfaces(server: viser.ViserServer, client: int) -> list[Any]:
    own = server.get_clients().get(client)
    return [server.gui] if own is None else [server.gui, own.gui]


def input_state(handle: Any) -> tuple[str, Any, bool, Collection[str] | None]:
    """(label, value, whether it is a button, options of a menu or None) of a widget."""
    props = handle._impl.props
    return (
        getattr(props, "label", "") or "this control",
        handle._impl.value,
        handle._impl.is_button,
        getattr(props, "options", None),
    )


def show_true_value(handle: Any) -> None:
    """Send a widget's value again to browsers that show another one."""
    update = _messages.GuiUpdateMessage(handle._impl.uuid, {"value": handle._impl.value})
    handle._impl.gui_api._websock_interface.queue_message(update)


def scene_instances(server: viser.ViserServer, name: str) -> int | None:
    """How many instances a node of the scene has: 0 for one that is no batch, None if there is no such node."""
    handle = server.scene._handle_from_node_name.get(name)
    if handle is None:
        return None
    positions = getattr(handle._impl.props, "batched_positions", None)
    return 0 if positions is None else len(positions)


def forget_acknowledgements(server: viser.ViserServer, transfers: Collection[str]) -> None:
    """Drop the acknowledgements of finished uploads: viser keeps them all, and sends them to every new browser."""
    acknowledgement = _messages.FileTransferPartAck
    server._websock_server.get_message_buffer().remove_from_buffer(
        lambda message: isinstance(message, acknowledgement) and message.transfer_uuid in transfers
    )


def send_plot_data(handle: viser.GuiUplotHandle, columns: tuple[Any, ...]) -> None:
    """Send new data to a chart in their own type: assigned to viser's handle, every number would take eight bytes."""
    handle._impl.props.data = columns
    handle._queue_update("data", columns)


def mark_slider(handle: viser.GuiInputHandle[Any], marks: tuple[tuple[float, str], ...]) -> None:
    """Change the marks, (value, label) each, of an existing slider: viser takes them only when it is made."""
    shown = tuple(_messages.GuiSliderMark(value, label) for value, label in marks)
    handle._impl.props._marks = shown
    handle._queue_update("_marks", shown)


def in_the_systems_colors(page: str) -> str:
    """A serialized scene's HTML, dark where the reader's system is: viser decides it when the file is written."""
    fixed = "window.__VISER_EMBED_CONFIG__={darkMode:false};"
    asked = "window.__VISER_EMBED_CONFIG__={darkMode:matchMedia('(prefers-color-scheme: dark)').matches};"
    head, found, rest = page.rpartition(fixed)
    return head + asked + rest if found else page
