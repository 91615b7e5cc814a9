"""`<run>.json` beside `<run>.rrd`: metrics and changes, how the run ended, a person's note, and the state of the file."""

import contextlib
import errno
import json
import os
import threading
from collections.abc import Generator, Iterable
from pathlib import Path
from typing import Any

from flexlab.files import lock, read_json, replacing

LARGEST_NOTES = 10_000_000
"""Largest size of a file of notes that is read, bytes: an hour of dragging sliders makes one."""
MEASURED = "measured_file"
"""Key in the notes: size, bytes, and modification time, s, of the file that the metrics belong to."""
SOUND = "sound"
"""Key in the notes: size, modification time, ns, and inode of the file on which rerun's reader does not crash."""
SAME_TIME = 2.0
"""Largest difference between two times of one file, s: disks and archives round them."""
OF_PEOPLE = ("note", "tags", "keep", "owner", "visitor")
"""Notes that stay when another file takes a recording's name."""
OF_RUNS = (
    "ended",
    "preset",
    "status",
    "metrics",
    "changes",
    "rows",
    "recovered",
    "damaged_size",
    "imported",
    "lessons",
    SOUND,
)
"""Other notes, of which every file of notes that flexlab began has one at least, unless it has those `OF_PEOPLE`."""


def notes_path(path: Path) -> Path:
    """The file of notes beside a recording."""
    return path.with_suffix(".json")


def read_notes(path: Path) -> dict[str, Any]:
    """The notes beside a recording; empty if there are none or they cannot be read.

    Only those `OF_PEOPLE` if another file has taken its name since the metrics were written.
    """
    try:
        notes = read_json(notes_path(path), LARGEST_NOTES)
    except (OSError, ValueError):
        return {}
    if not isinstance(notes, dict):
        return {}
    return {name: notes[name] for name in OF_PEOPLE if name in notes} if _is_another(path, notes) else notes


def _is_another(path: Path, notes: dict[str, Any]) -> bool:
    """Whether a recording has neither the size nor the time of the file that the metrics belong to.

    A copy has its size, and a mended one its time.
    """
    try:
        size, time = notes[MEASURED]
        now = path.stat()
        return size != now.st_size and abs(time - now.st_mtime) > SAME_TIME
    except (KeyError, TypeError, ValueError, OSError):
        return False


def check_notes(path: Path, changes: Iterable[str] = ()) -> None:
    """Raise FileExistsError if the notes' file is JSON without any of these or usual notes, as a scenario of the same name."""
    try:
        found = read_json(notes_path(path), LARGEST_NOTES)
    except (OSError, ValueError):
        return
    if found != {} and not (isinstance(found, dict) and found.keys() & {*OF_PEOPLE, *OF_RUNS, *changes}):
        raise FileExistsError(errno.EEXIST, f"{notes_path(path).name} beside it holds something else")


def write_notes(path: Path, **changes: Any) -> None:
    """Change some of the notes beside a recording; others stay. Raises OSError, as `check_notes` does."""
    check_notes(path, changes)
    if "metrics" in changes:
        with contextlib.suppress(OSError):  # The recording was deleted meanwhile.
            measured = path.stat()
            changes[MEASURED] = [measured.st_size, measured.st_mtime]
    with _one_at_a_time(path.parent):
        notes = read_notes(path) | changes
        with replacing(notes_path(path)) as draft:
            # Characters that are no text become escapes that JSON knows.
            draft.write_bytes(json.dumps(notes, indent=1, ensure_ascii=False).encode("utf-8", "backslashreplace"))


_WRITING = threading.Lock()
ATTEMPTS = 200
"""Largest number of attempts to lock the folder: a process that hangs must not stop all others."""


@contextlib.contextmanager
def _one_at_a_time(folder: Path) -> Generator[None]:
    """Keep all others from changing notes in the folder meanwhile, so that no change is lost."""
    with _WRITING, contextlib.ExitStack() as closing:
        # Windows does not open folders; any other problem with the folder shows when the notes are written.
        with contextlib.suppress(OSError):
            handle = os.open(folder, os.O_RDONLY)
            closing.callback(os.close, handle)
            lock(handle, ATTEMPTS)
        yield
