"""The folders of flexlab's data files, `presets/` and `web_assets/`, and of its cache.

In a source checkout they are folders beside the package; in an installed wheel they are inside it, under `_data`.
"""

import atexit
import logging
import os
import shutil
import tempfile
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parent


def data_folder(name: str) -> Path:
    """The folder `name` ("presets" or "web_assets"). Raises FileNotFoundError if the installation lacks it."""
    for folder in (_PACKAGE / "_data" / name, _PACKAGE.parent / name):
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"This installation of flexlab has no folder {name}: install flexlab again.")


def presets_folder() -> Path:
    """The folder of flexlab's own presets (scenario files)."""
    return data_folder("presets")


def web_assets_folder() -> Path:
    """The folder of the lab's models, pictures and guide."""
    return data_folder("web_assets")


def user_cache() -> Path:
    """The user's cache folder, or a temporary one for this process if that cannot be written."""
    given = os.environ.get("XDG_CACHE_HOME")
    try:
        folder = Path(given) if given else Path.home() / ".cache"
    except RuntimeError:  # A container's user may have no home, and no name.
        return _passing_cache("You have no home folder")
    return folder if _is_writable(folder / "flexlab") else _passing_cache(f"{folder} cannot be written")


def code_cache() -> Path:
    """The folder of machine code, below NUMBA_CACHE_DIR or the user's cache folder."""
    base = os.environ.get("NUMBA_CACHE_DIR")
    return (Path(base) if base else user_cache()) / "flexlab"


@cache  # Each kernel asks.
def _is_writable(folder: Path) -> bool:
    """Whether this user may make a folder or, if it exists, write into it."""
    there = next((each for each in (folder, *folder.parents) if os.path.exists(each)), folder)
    return there.is_dir() and os.access(there, os.W_OK | os.X_OK)


@cache
def _passing_cache(why: str) -> Path:
    """A cache folder for this process only: machine code in a folder that others could make first would not be safe."""
    folder = Path(tempfile.mkdtemp(prefix="flexlab-cache-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["XDG_CACHE_HOME"] = str(folder)  # For processes that this one starts.
    logging.getLogger("flexlab").warning(
        "%s: each start compiles the equations of motion anew. Set XDG_CACHE_HOME to a folder that you may write to.",
        why,
    )
    return folder
