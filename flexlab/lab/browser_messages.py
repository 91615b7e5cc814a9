"""The messages that the lab's page may send, with the type and range of each field. All others are refused."""

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import msgspec

LARGEST_MESSAGE = 1_200_000
"""Size of the largest message, bytes: the page sends files in parts of 512 kB, and everything else in a few hundred bytes."""
FARTHEST = 1e9
"""Largest coordinate that is accepted, m or pixels."""
LEAST_DIRECTION = 1e-6
"""Length of the shortest vector that counts as a direction."""

MAPS = frozenset((*range(0x80, 0x90), 0xDE, 0xDF))
"""First bytes of a map in MessagePack."""

Identifier = Annotated[str, msgspec.Meta(min_length=1, max_length=64)]
NodeName = Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
Words = Annotated[str, msgspec.Meta(max_length=255)]
Pixels = Annotated[int, msgspec.Meta(ge=1, le=100_000)]
Angle = Annotated[float, msgspec.Meta(gt=0, lt=math.pi)]
Distance = Annotated[float, msgspec.Meta(gt=0)]
Count = Annotated[int, msgspec.Meta(ge=0, le=1_000_000_000)]
Pair = tuple[float, float]
Triple = tuple[float, float, float]
Modifier = Literal["cmd/ctrl", "alt", "shift", "cmd/ctrl+alt", "cmd/ctrl+shift", "alt+shift", "cmd/ctrl+alt+shift"]


class BrowserMessage(msgspec.Struct, frozen=True, tag_field="type", forbid_unknown_fields=True):
    """A message of viser's page, named as there."""


class ViewerCameraMessage(BrowserMessage, frozen=True, tag=True):
    """The camera of a browser."""

    wxyz: tuple[float, float, float, float]
    position: Triple
    fov: Angle
    near: Distance
    far: Distance
    image_height: Pixels
    image_width: Pixels
    look_at: Triple
    up_direction: Triple


class GuiUpdateMessage(BrowserMessage, frozen=True, tag=True):
    """A person changed a widget. The widget decides which values are valid."""

    uuid: Identifier
    updates: dict[str, Any]


class GuiButtonHoldMessage(BrowserMessage, frozen=True, tag=True):
    """A person holds a button down."""

    uuid: Identifier
    frequency: float


class CommandTriggerMessage(BrowserMessage, frozen=True, tag=True):
    """A person pressed a key or chose a line of the command palette."""

    uuid: Identifier


class FileTransferStartUpload(BrowserMessage, frozen=True, tag=True):
    """An upload begins."""

    source_component_uuid: Identifier
    transfer_uuid: Identifier
    filename: Words
    mime_type: Words
    part_count: Count
    size_bytes: Count


class FileTransferPart(BrowserMessage, frozen=True, tag=True):
    """A part of an upload."""

    source_component_uuid: Identifier
    transfer_uuid: Identifier
    part_index: Count
    content: bytes


class SceneNodeClickMessage(BrowserMessage, frozen=True, tag=True):
    """A click on something in the picture."""

    name: NodeName
    instance_index: Count | None
    ray_origin: Triple
    ray_direction: Triple
    screen_pos: Pair
    modifier: Modifier | None
    owner: Literal[""] = ""


class SceneNodeDragMessage(BrowserMessage, frozen=True, tag=True):
    """Something in the picture is being dragged."""

    phase: Literal["start", "update", "end"]
    name: NodeName
    instance_index: Count | None
    start_position: Triple
    start_screen_pos: Pair
    end_position: Triple
    end_screen_pos: Pair
    button: Literal["left", "middle", "right"]
    modifier: Modifier | None
    owner: Literal[""] = ""


Heard = (
    ViewerCameraMessage
    | GuiUpdateMessage
    | GuiButtonHoldMessage
    | CommandTriggerMessage
    | FileTransferStartUpload
    | FileTransferPart
    | SceneNodeClickMessage
    | SceneNodeDragMessage
)
"""All messages that are accepted."""

_DECODER = msgspec.msgpack.Decoder(Heard)


class Refused(Exception):
    """A message that is refused; the text says why, for the log. `told`: a sentence for the screen, or empty."""

    def __init__(self, why: str, told: str = ""):
        self.told = told
        super().__init__(why)


class Unreadable(Refused):
    """Bytes that are no message: they do not come from the lab's page."""


def decode(raw: Any) -> Heard:
    """Decode what a browser sent. Raises `Refused` if it is none of the messages, or has an impossible value."""
    if not isinstance(raw, bytes) or not raw or raw[0] not in MAPS:
        raise Unreadable("it has no fields")
    try:
        message = _DECODER.decode(raw)
    except msgspec.ValidationError as error:
        raise Refused(_shown(error)) from None
    except (msgspec.MsgspecError, RecursionError, ValueError) as error:
        raise Unreadable(_shown(error)) from None
    if not all(abs(number) <= FARTHEST for number in _places(message)):
        raise Refused(f"{type(message).__name__} has a number that is not finite, or over {FARTHEST:g}")
    if isinstance(message, ViewerCameraMessage):
        sight = math.dist(message.look_at, message.position)
        if min(math.hypot(*message.wxyz), math.hypot(*message.up_direction), sight) < LEAST_DIRECTION:
            raise Refused("ViewerCameraMessage has a direction without length")
    return message


def _shown(error: Exception) -> str:
    """A decoder's reason, made safe for the log: it can quote what a browser sent."""
    return ascii(str(error)[:200])[1:-1]


def _places(message: Heard) -> Iterator[float]:
    """The numbers of a message's fields, vectors included; NaN compares false with everything."""
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if isinstance(value, tuple):
            yield from value
        elif isinstance(value, (int, float)):
            yield value
