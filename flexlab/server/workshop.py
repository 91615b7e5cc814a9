"""A folder for files that nobody keeps. It is locked by its server; those of servers that were killed are swept."""

import contextlib
import shutil
import tempfile
import time
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # Windows: there nothing is swept
    fcntl = None

PREFIX = "flexlab-server-"
LOCK = "in-use"
"""A file in the folder whose lock dies with its server: a process's number alone may be another one's by now."""
YOUNG = 60.0
"""s within which a folder without a lock may be one that is just being made."""


class Workshop:
    """A new folder of one server's own."""

    def __init__(self) -> None:
        sweep()
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._lock = (self.path / LOCK).open("wb")
        if fcntl is not None:
            fcntl.flock(self._lock, fcntl.LOCK_EX)

    def close(self) -> None:
        """Remove it with all that is in it."""
        self._lock.close()
        shutil.rmtree(self.path, ignore_errors=True)


def sweep() -> None:
    """Remove the folders of servers that are no more."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError):
        for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
            with contextlib.suppress(OSError):
                if folder.is_dir() and not folder.is_symlink() and _is_left(folder):
                    shutil.rmtree(folder, ignore_errors=True)


def _is_left(folder: Path) -> bool:
    """Whether no server has it. Raises OSError for a folder that is another person's."""
    try:
        lock: IO[bytes] = (folder / LOCK).open("rb")
    except FileNotFoundError:
        return time.time() - folder.stat().st_mtime > YOUNG
    with lock:
        if fcntl is None:
            return False
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True
