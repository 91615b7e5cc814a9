"""A client that sends what no proper browser would, in viser's wire format."""

import json
from collections.abc import Iterator
from types import TracebackType
from typing import Any

import msgspec.msgpack
import viser
import zstandard
from websockets.sync.client import ClientConnection, connect

from flexlab.lab.session import Session

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [0.0, 0.0, 5.0],
    "fov": 0.5,
    "near": 0.01,
    "far": 100.0,
    "image_height": 900,
    "image_width": 1440,
    "look_at": [0.0, 0.5, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}


def widget(session: Session, label: str) -> Any:
    """Return the server's handle of the widget with this label."""
    handles = list(session.server.gui._gui_input_handle_from_uuid.values())
    return next(handle for handle in handles if getattr(handle._impl.props, "label", None) == label)


def html_texts(session: Session) -> list[Any]:
    """Return the handles of all HTML texts in the panel."""
    found, queue = [], list(session.server.gui._container_handle_from_uuid.values())
    for container in queue:
        found += [child for child in container._children.values() if type(child).__name__ == "GuiHtmlHandle"]
    return found


def open_socket(address: str) -> ClientConnection:
    """Open a connection to ws://… as the page does, and send the position of the camera."""
    protocol: Any = f"viser-v{viser.__version__}"
    # The lab goes on sending and is slow to close; a browser would not wait for that either.
    plug = connect(address, subprotocols=[protocol], max_size=None, close_timeout=0.2, ping_interval=None)
    plug.send(msgspec.msgpack.encode(CAMERA))
    return plug


def text_of(data: bytes) -> str:
    """Return the contents of a window of messages from the lab as text."""
    return _unpacked(data).decode("utf-8", "replace")


def _unpacked(data: bytes) -> bytes:
    size = int.from_bytes(data[8:16], "little")
    return zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])


def _mappings(part: Any) -> Iterator[dict[str, Any]]:
    """Yield all dictionaries within decoded messages."""
    if isinstance(part, dict):
        yield part
    for inner in part.values() if isinstance(part, dict) else part if isinstance(part, list) else ():
        yield from _mappings(inner)


def page_report(run: int, **told: Any) -> str:
    """Return the report of a page that has drawn a run; it shows no charts unless `told` has some."""
    usual = {
        "charts": {},
        "dark": False,
        "width": 1440,
        "covered": (0, 0),
        "height": 900,
        "open": (),
        "hears": False,
        "again": 0,
    }
    return json.dumps(usual | {"run": run, **told})


class RawBrowser:
    """A connection to a session; a context manager."""

    def __init__(self, session: Session):
        self._socket = open_socket(session.url.replace("http", "ws"))

    def send(self, message: dict[str, Any]) -> None:
        """Send one message."""
        self._socket.send(msgspec.msgpack.encode(message))

    def send_bytes(self, data: bytes) -> None:
        """Send bytes that need not be a message."""
        self._socket.send(data)

    def update(self, handle: Any, updates: dict[str, Any]) -> None:
        """Claim that a person changed a widget."""
        self.send({"type": "GuiUpdateMessage", "uuid": handle._impl.uuid, "updates": updates})

    def receive(self, seconds: float) -> bytes:
        """Return the next message from the lab."""
        data = self._socket.recv(timeout=seconds)
        assert isinstance(data, bytes)
        return data

    def receive_values(self) -> dict[str, Any]:
        """Return the values of widgets in the next message from the lab, by the widget's uuid."""
        window = msgspec.msgpack.decode(_unpacked(self.receive(20.0)))
        told = [message for message in _mappings(window) if "value" in message.get("updates", {})]
        return {message["uuid"]: message["updates"]["value"] for message in told}

    def values_of(self, handle: Any) -> list[Any]:
        """Return the values of a widget in the next message from the lab: one or none."""
        values = self.receive_values()
        return [values[handle._impl.uuid]] if handle._impl.uuid in values else []

    def hears_of(self, transfer: str) -> bool:
        """Whether the next message from the lab acknowledges a part of a file."""
        window = msgspec.msgpack.decode(_unpacked(self.receive(20.0)))
        return any(message.get("transfer_uuid") == transfer for message in _mappings(window))

    def camera_positions(self) -> list[tuple[float, ...]]:
        """Return the positions to which the next message from the lab moves the camera, m."""
        window = msgspec.msgpack.decode(_unpacked(self.receive(20.0)))
        return [tuple(each["position"]) for each in _mappings(window) if each.get("type") == "SetCameraPositionMessage"]

    def __enter__(self) -> "RawBrowser":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._socket.close()
