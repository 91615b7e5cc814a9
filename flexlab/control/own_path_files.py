"""Where paths in Python come from: a person's folder `presets/paths`, the examples of flexlab, a file, a class."""

import inspect
import re
from pathlib import Path
from typing import Any

from flexlab.assets import presets_folder
from flexlab.control.own_law_files import text_of
from flexlab.control.own_path import PythonPath, add_own_path
from flexlab.control.path import add_path_file, paths
from flexlab.errors import ScenarioError
from flexlab.own_paths.declaration import OwnPath, read_path_declaration

OWN_FOLDER = Path("presets/paths")
"""A person's own paths, relative to the working directory."""

_added: set[str] = set()
"""Files that held a path in Python."""
_kernels: dict[str, str] = {}
"""File → kind of the paths that are kernels: a second one of that kind would be another path."""


def path_files() -> list[Path]:
    """All files of paths, a person's own first; an example of flexlab gives way to an own file of its name."""
    found: dict[str, Path] = {}
    for folder in (OWN_FOLDER, presets_folder() / "paths"):
        for path in sorted(folder.glob("*.py")):
            if path.is_file():
                found.setdefault(path.name, path)
    return list(found.values())


def _read(path: Path) -> str:
    """The text of a path's file. Raises `ScenarioError`."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        text = f"There is no file {path}: give the path of a Python file with a desired motion."
        raise ScenarioError([("trajectory.source", text)]) from None
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no text in UTF-8"
        raise ScenarioError([("trajectory.source", f"{path} cannot be read: {why}.")]) from None


def holds_path(file: str | Path) -> bool:
    """Whether a Python file holds a path, or did when it was added."""
    if str(Path(file).resolve()) in _added:
        return True
    try:
        return (
            re.search(r"^class\s+\w+\s*\([^:\n]*\bOwnPath\b", Path(file).read_text(encoding="utf-8"), re.MULTILINE)
            is not None
        )
    except (OSError, UnicodeDecodeError):
        return False


def add_own_path_file(file: str | Path) -> PythonPath:
    """Make the path of a Python file known and let it run. Raises `ScenarioError`, with file and line."""
    place = str(Path(file).resolve())
    path = add_own_path(_read(Path(file)), place)
    _added.add(place)
    return path


def add_path_files() -> list[str]:
    """Make all paths of `path_files` known; returns a sentence for each that cannot be. None of them runs by that."""
    problems = []
    for file in path_files():
        try:
            path_kind(file)
        except ScenarioError as error:
            problems.append(f"A path is left out: {error}")
    return problems


def path_kind(path: Any) -> str:
    """The kind of a path given by its name, by a Python file, or as a class. Raises `ScenarioError`."""
    if isinstance(path, Path) or (isinstance(path, str) and path.endswith(".py")):
        kernel = _kernel_path(Path(path))
        if not kernel and not holds_path(path):
            text = f"{path} holds no path that can be used: it needs a class Name(OwnPath), or PATH = Path(...)."
            raise ScenarioError([("trajectory.source", text)])
        return kernel or add_own_path_file(path).kind
    if isinstance(path, type) and issubclass(path, OwnPath):
        return add_own_path(text_of(path), inspect.getsourcefile(path) or path.__name__).kind
    if not isinstance(path, str):
        text = f"path = {path!r:.60} is no path: give a name such as circle, a file, or a class of OwnPath."
        raise ScenarioError([("trajectory.kind", text)])
    if path not in paths():
        for file in path_files():
            if _declares(file, path):
                return add_own_path_file(file).kind
    return path


def _kernel_path(file: Path) -> str:
    """The kind of a path that a file defines as a kernel (`PATH = Path(...)`), or nothing. Raises `ScenarioError`."""
    if not re.search(r"^PATH\s*=", _read(file), re.MULTILINE):
        return ""
    place = str(file.resolve())
    if _kernels.get(place) in paths():
        return _kernels[place]
    try:
        _kernels[place] = add_path_file(file).kind
        return _kernels[place]
    except Exception as error:
        text = f"{file.name} cannot be used ({type(error).__name__}: {error})."
        raise ScenarioError([("trajectory.kind", text)]) from None


def _declares(file: Path, kind: str) -> bool:
    try:
        return read_path_declaration(_read(file), file.name).kind == kind
    except ScenarioError:
        return False
