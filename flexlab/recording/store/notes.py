"""`<run>.json` beside `<run>.rrd`: metrics and changes, how the run ended, a person's note, and the state of the file."""

import contextlib
import json
import os
import threading
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

from flexlab.files import read_json, replacing

try:
    import fcntl
except ImportError:  # Windows: there only threads of one process wait for one another.
    fcntl = None

LARGEST_NOTES = 10_000_000
"""Bytes of the largest file of notes that is read: an hour of dragging sliders makes one."""


def notes_path(path: Path) -> Path:
    """The file of notes beside a recording."""
    return path.with_suffix(".json")


def read_notes(path: Path) -> dict[str, Any]:
    """The notes beside a recording; empty if there are none or they cannot be read."""
    try:
        notes = read_json(notes_path(path), LARGEST_NOTES)
    except (OSError, ValueError):
        return {}
    return notes if isinstance(notes, dict) else {}


def write_notes(path: Path, **changes: Any) -> None:
    """Change some of the notes beside a recording; others stay. Raises OSError."""
    with _one_at_a_time(path.parent):
        notes = read_notes(path) | changes
        with replacing(notes_path(path)) as draft:
            # What is no text becomes an escape that JSON knows.
            draft.write_bytes(json.dumps(notes, indent=1, ensure_ascii=False).encode("utf-8", "backslashreplace"))


_WRITING = threading.Lock()
ATTEMPTS, PAUSE = 200, 0.01
"""How often, and with how many s between, a change waits for another process: a hanging one must not stop all."""


@contextlib.contextmanager
def _one_at_a_time(folder: Path) -> Generator[None]:
    """While this is open nobody else changes notes in the folder, so that no change is lost."""
    with _WRITING, contextlib.ExitStack() as closing:
        if fcntl is not None:
            with contextlib.suppress(OSError):  # Writing itself tells what is wrong with the folder.
                handle = os.open(folder, os.O_RDONLY)
                closing.callback(os.close, handle)
                for _ in range(ATTEMPTS):
                    with contextlib.suppress(BlockingIOError):
                        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                        break
                    time.sleep(PAUSE)
        yield
