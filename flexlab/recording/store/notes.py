"""`<run>.json` beside `<run>.rrd`: metrics and changes, how the run ended, a person's note, and the state of the file."""

import contextlib
import json
import os
import threading
from collections.abc import Generator
from pathlib import Path
from typing import Any

from flexlab.files import lock, read_json, replacing

LARGEST_NOTES = 10_000_000
"""Bytes of the largest file of notes that is read: an hour of dragging sliders makes one."""


MEASURED = "measured_file"
"""Which file the metrics in the notes are of: its bytes, and when it was last written, s."""
SAME_TIME = 2.0
"""s between two times of one file: disks and archives round them."""
OF_PEOPLE = ("note", "tags", "keep", "owner", "visitor")
"""Notes that stay when another file takes a recording's name."""


def notes_path(path: Path) -> Path:
    """The file of notes beside a recording."""
    return path.with_suffix(".json")


def read_notes(path: Path) -> dict[str, Any]:
    """The notes beside a recording; empty if there are none or they cannot be read.

    Only those `OF_PEOPLE` if another file has taken its name since it was measured.
    """
    try:
        notes = read_json(notes_path(path), LARGEST_NOTES)
    except (OSError, ValueError):
        return {}
    if not isinstance(notes, dict):
        return {}
    return {name: notes[name] for name in OF_PEOPLE if name in notes} if _is_another(path, notes) else notes


def _is_another(path: Path, notes: dict[str, Any]) -> bool:
    """Whether a recording has neither the size nor the time of the file that was measured.

    A copy has its size, and a mended one its time.
    """
    try:
        size, time = notes[MEASURED]
        now = path.stat()
        return size != now.st_size and abs(time - now.st_mtime) > SAME_TIME
    except (KeyError, TypeError, ValueError, OSError):
        return False


def write_notes(path: Path, **changes: Any) -> None:
    """Change some of the notes beside a recording; others stay. Raises OSError."""
    if "metrics" in changes:
        with contextlib.suppress(OSError):  # The recording was deleted meanwhile.
            measured = path.stat()
            changes[MEASURED] = [measured.st_size, measured.st_mtime]
    with _one_at_a_time(path.parent):
        notes = read_notes(path) | changes
        with replacing(notes_path(path)) as draft:
            # What is no text becomes an escape that JSON knows.
            draft.write_bytes(json.dumps(notes, indent=1, ensure_ascii=False).encode("utf-8", "backslashreplace"))


_WRITING = threading.Lock()
ATTEMPTS = 200
"""How often a change tries to lock the folder: another process that hangs must not stop all."""


@contextlib.contextmanager
def _one_at_a_time(folder: Path) -> Generator[None]:
    """While this is open nobody else changes notes in the folder, so that no change is lost."""
    with _WRITING, contextlib.ExitStack() as closing:
        # Writing itself tells what is wrong with the folder, which Windows does not open.
        with contextlib.suppress(OSError):
            handle = os.open(folder, os.O_RDONLY)
            closing.callback(os.close, handle)
            lock(handle, ATTEMPTS)
        yield
