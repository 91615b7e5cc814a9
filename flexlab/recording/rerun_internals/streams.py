"""Rerun's streams, begun and given up so that nothing of them is left, and how their pieces make one file.

Each piece that rerun encodes is a small file of its own: a head, messages (kind and length, 8 bytes each, then the body), an
end message with an index, and a foot. A larger file is one head and the messages of all pieces; `repair` adds the end.
"""

import os
import struct
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun_bindings import flush_and_cleanup_orphaned_recordings

from flexlab.errors import RecordingError


def new_stream(application: str, run_id: str | None = None) -> rr.RecordingStream:
    """A stream without properties of rerun's own; `application`: whose layouts a person's changes hold for."""
    # As `rerun.init` does: a stream that nobody has any more keeps two threads and a megabyte.
    flush_and_cleanup_orphaned_recordings()
    stream = rr.RecordingStream(application, recording_id=run_id, send_properties=False)
    # Wall-clock axes would only be a second, jumpy time beside the simulation's own.
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


class _Layout:
    """A layout that tells by which stream rerun sends it."""

    def __init__(self, layout: rrb.Blueprint):
        self._layout, self.streams = layout, list[rr.RecordingStream]()

    def to_blueprint(self) -> "_Layout":
        return self

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self.streams.append(stream)
        self._layout._log_to_stream(stream)


def send_layout(stream: rr.RecordingStream, layout: rrb.Blueprint) -> None:
    """Send a layout, to be shown at once."""
    sent: Any = _Layout(layout)
    stream.send_blueprint(sent, make_active=True, make_default=True)
    for each in sent.streams:  # Connected it would hold itself, and never end.
        each.disconnect()


MAGIC = b"RRF2"
"""How a rerun file of this generation begins."""
HEAD = 12
"""Bytes of the head: magic, version, options."""
MESSAGE = struct.Struct("<QQ")
"""Kind and length of a message's body."""
END = 0
"""Kind of the end message."""
FAMILY = b"RRF"
"""How a rerun file of any version begins."""
FOOTER, FOOTER_PLACE = b"RRF2FOOT", 12
"""How the last bytes of a finished file begin, and how many they are."""


def messages(piece: bytes, with_head: bool) -> bytes:
    """A piece without its end and foot, and without its head unless asked for."""
    if piece[: len(MAGIC)] != MAGIC:
        raise RecordingError(f"Rerun encodes as {piece[:4]!r}, not {MAGIC!r}: this flexlab needs rerun-sdk 0.41.")
    place = HEAD
    while place < len(piece):
        kind, length = MESSAGE.unpack_from(piece, place)
        if kind == END:
            break
        place += MESSAGE.size + length
    return piece[0 if with_head else HEAD : place]


def has_footer(path: Path) -> bool:
    """Whether the file ends as a finished rerun file does."""
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - FOOTER_PLACE))
        return file.read().startswith(FOOTER)
