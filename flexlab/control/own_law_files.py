"""Where laws in Python come from: a person's folder `presets/laws`, the examples of flexlab, a path, a class."""

import inspect
import re
import textwrap
from pathlib import Path
from typing import Any

from flexlab.assets import presets_folder
from flexlab.control.law import add_law_file, laws
from flexlab.control.own_law import PythonLaw, add_own_law
from flexlab.errors import ScenarioError
from flexlab.own_laws.declaration import OwnLaw, read_declaration

OWN_FOLDER = Path("presets/laws")
"""A person's own laws, relative to the working directory."""

HEADER = "import math\nimport flexlab\nimport numpy as np\nfrom flexlab import OwnLaw, OwnPath, gain, memory, option, readout"
"""What the text of a class may take for granted, so that a recording can hold it."""


def law_files() -> list[Path]:
    """All files of laws, a person's own first; an example of flexlab gives way to an own file of its name."""
    found: dict[str, Path] = {}
    for folder in (OWN_FOLDER, presets_folder() / "laws"):
        for path in sorted(folder.glob("*.py")):
            if path.is_file():
                found.setdefault(path.name, path)
    return list(found.values())


def _read(path: Path) -> str:
    """The text of a law's file. Raises `ScenarioError`."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        text = f"There is no file {path}: give the path of a Python file with a control law."
        raise ScenarioError([("controller.source", text)]) from None
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is no text in UTF-8"
        raise ScenarioError([("controller.source", f"{path} cannot be read: {why}.")]) from None


def add_own_law_file(path: str | Path) -> PythonLaw:
    """Make the law of a Python file known and let it run. Raises `ScenarioError`, with file and line."""
    return add_own_law(_read(Path(path)), str(Path(path).resolve()))


def add_law_files() -> list[str]:
    """Make all laws of `law_files` known; returns a sentence for each that cannot be. None of them runs by that."""
    problems = []
    for path in law_files():
        try:
            add_own_law_file(path)
        except ScenarioError as error:
            problems.append(f"A control law is left out: {error}")
    return problems


def law_kind(law: Any) -> str:
    """The kind of a law given by its name, by the path of a Python file, or as a class. Raises `ScenarioError`."""
    if isinstance(law, Path) or (isinstance(law, str) and law.endswith(".py")):
        return _kernel_law(Path(law)) or add_own_law_file(law).kind
    if isinstance(law, type) and issubclass(law, OwnLaw):
        return add_own_law(text_of(law), inspect.getsourcefile(law) or law.__name__).kind
    if not isinstance(law, str):
        text = f"law = {law!r:.60} is no control law: give a name such as pd, a Python file, or a class of OwnLaw."
        raise ScenarioError([("controller.kind", text)])
    if law not in laws():
        for path in law_files():
            if _declares(path, law):
                return add_own_law_file(path).kind
    return law


def _kernel_law(path: Path) -> str:
    """The kind of a law that a file defines as a kernel (`LAW = Law(...)`); empty if it defines none. Raises `ScenarioError`."""
    if not re.search(r"^LAW\s*=", _read(path), re.MULTILINE):
        return ""
    try:
        return add_law_file(path).kind
    except Exception as error:
        text = f"{path.name} cannot be used ({type(error).__name__}: {error})."
        raise ScenarioError([("controller.kind", text)]) from None


def _declares(path: Path, kind: str) -> bool:
    try:
        return read_declaration(_read(path), path.name).kind == kind
    except ScenarioError:
        return False


def text_of(law: type) -> str:
    """A class's own text after `HEADER`, with the line numbers of its file where there is room for the header."""
    try:
        lines, first = inspect.getsourcelines(law)
    except (OSError, TypeError):
        what = f"The text of the class {law.__name__} cannot be found, which a recording needs: write it in a file."
        raise ScenarioError([("controller.source", what)]) from None
    above = HEADER.count("\n") + 1
    return HEADER + "\n" * max(1, first - above) + textwrap.dedent("".join(lines))
