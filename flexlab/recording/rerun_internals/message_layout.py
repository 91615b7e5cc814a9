"""How a rerun file is put together.

Each piece that rerun encodes is a small file of its own: a head, messages (kind and length, 8 bytes each, then the body), an
end message with an index, and a foot. A larger file is one head and the messages of all pieces; `repair` adds the end.
"""

import os
import struct
from pathlib import Path

from flexlab.errors import RecordingError

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
