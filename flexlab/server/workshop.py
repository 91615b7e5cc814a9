"""A folder for files that nobody keeps, named after its process; those of servers that were killed are swept."""

import contextlib
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

_NAME = re.compile(r"flexlab-server-(\d+)-\w+")


def make_workshop() -> Path:
    """A new folder of this process's own."""
    sweep()
    return Path(tempfile.mkdtemp(prefix=f"flexlab-server-{os.getpid()}-"))


def sweep() -> None:
    """Remove the folders of servers that are no more."""
    if sys.platform == "win32":  # There, asking for a process would end it.
        return
    with contextlib.suppress(OSError):
        for folder in Path(tempfile.gettempdir()).glob("flexlab-server-*"):
            found = _NAME.fullmatch(folder.name)
            if found and folder.is_dir() and not folder.is_symlink() and not _runs(int(found[1])):
                shutil.rmtree(folder, ignore_errors=True)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
