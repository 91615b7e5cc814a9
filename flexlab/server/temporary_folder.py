"""A server's temporary folder. Its server locks it, and a later server removes the folders of servers that were killed."""

import contextlib
import shutil
import tempfile
import time
from pathlib import Path
from typing import IO

try:
    import fcntl
except ImportError:  # On Windows no folder is removed.
    fcntl = None

PREFIX = "flexlab-server-"
LOCK = "in-use"
"""A file in the folder whose lock ends with its server; a process's number could belong to another process by now."""
YOUNG = 60.0
"""Age of a folder without a lock file, s, up to which it may be one that is just being made."""


class TemporaryFolder:
    """A new temporary folder."""

    def __init__(self) -> None:
        remove_left()
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._lock = (self.path / LOCK).open("wb")
        if fcntl is not None:
            fcntl.flock(self._lock, fcntl.LOCK_EX)

    def close(self) -> None:
        """Remove the folder with its files."""
        self._lock.close()
        shutil.rmtree(self.path, ignore_errors=True)


def remove_left() -> None:
    """Remove the folders of servers that no longer run."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError):
        for folder in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
            with contextlib.suppress(OSError):
                if folder.is_dir() and not folder.is_symlink() and _is_left(folder):
                    shutil.rmtree(folder, ignore_errors=True)


def _is_left(folder: Path) -> bool:
    """Whether no server holds the folder. Raises OSError for another user's folder."""
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
