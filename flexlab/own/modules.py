"""A person's own modules beside a law or path: they become a part of its text, as comments, and are imported from there.

Recordings, clusters and the keys of kept results then have all of the law, and laws of two folders may each have a `helper.py`.
Numba's machine code of the functions of a text that ask for it (`@njit(cache=True)`) is kept by the whole text, too.
"""

import ast
import builtins
import hashlib
import re
import sys
import sysconfig
from collections.abc import Mapping
from contextlib import suppress
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from flexlab.assets import code_cache
from flexlab.errors import ScenarioError
from flexlab.own.reading import data_names, with_data
from flexlab.text import syntax_tree

DIGEST = "__digest_of_text__"
"""Name of a module's variable with a digest of the text that it belongs to."""
OWN_TEXTS = "own-texts"
"""Folder of such machine code, with a folder for each text."""
_KEPT = re.compile(r"^# (\w+)\.py beside it:\n((?:#\|.*\n)*)", re.MULTILINE)


def with_modules(text: str, folder: Path, field: str) -> str:
    """A text with the data files that it names, and with the modules in `folder` that it imports, at its end, and theirs.

    `field`: the scenario's field that errors name. Raises `ScenarioError` for a file that cannot be kept.
    """
    text, found = with_data(text, folder, field), dict[str, str]()
    waiting = [text]
    while waiting:
        for name in sorted(_imported(waiting.pop()) - set(found)):
            file = folder / f"{name}.py"
            if not file.is_file() or not _is_own(name):
                continue
            try:
                found[name] = with_data(file.read_text(encoding="utf-8-sig"), folder, field)
            except (OSError, UnicodeDecodeError) as error:
                why = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
                raise ScenarioError([(field, f"{file} cannot be read: {why}.")]) from None
            waiting.append(found[name])
    kept = [f"# {name}.py beside it:\n" + "".join(f"#|{line}\n" for line in found[name].split("\n")) for name in found]
    return text.rstrip("\n") + "\n\n\n" + "".join(kept) if kept else text


def _kept(text: str) -> dict[str, str]:
    """Name → text of the modules that a text of `with_modules` has."""
    return {name: "\n".join(row[2:] for row in rows.split("\n")[:-1]) for name, rows in _KEPT.findall(text)}


def kept_files(text: str) -> set[str]:
    """The names of the files whose contents a text of `with_modules` has."""
    return {f"{name}.py" for name in _kept(text)}.union(data_names(text))


def packages_of(text: str) -> dict[str, str]:
    """Name → version of the installed packages that a text of `with_modules` imports, also through its modules."""
    kept = _kept(text)
    names = set[str]().union(*map(_imported, (text, *kept.values()))) - {*kept, *sys.stdlib_module_names, "flexlab"}
    return {package: version for name in sorted(names) for package, version in _installed(name)}


@cache
def _distributions() -> Mapping[str, list[str]]:
    """Module → packages of all that is installed; slow to make."""
    from importlib import metadata

    return metadata.packages_distributions()


def _installed(name: str) -> list[tuple[str, str]]:
    """(Name, version) of the packages that a module comes from; none if it is not installed."""
    from importlib import metadata  # Not each text's process needs it.

    with suppress(metadata.PackageNotFoundError):
        return [(name, metadata.version(name))]
    if PathFinder.find_spec(name) is None:
        return []
    return [(found, metadata.version(found)) for found in _distributions().get(name, ())]


def _imported(text: str) -> set[str]:
    """The names of modules that a text imports, the first parts of dotted ones; none if it is not valid Python."""
    try:
        nodes = list(ast.walk(syntax_tree(text)))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return set()
    whole = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    parts = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom) and not node.level]
    return {name.partition(".")[0] for name in whole + parts}


def _is_own(name: str) -> bool:
    """Whether no module of Python, flexlab or an installed package has this name: those come first."""
    installed = list(dict.fromkeys(map(sysconfig.get_path, ("purelib", "platlib"))))
    return name not in {*sys.stdlib_module_names, "flexlab"} and PathFinder.find_spec(name, installed) is None


class KeptModules:
    """The modules of a text: itself, and those kept in it, which it imports before any others.

    Others come from where Python finds them or, last of all, from beside `file`.
    """

    def __init__(self, text: str, file: str):
        folder = Path(file).resolve().parent
        if Path(file).exists() and str(folder) not in sys.path:
            sys.path.append(str(folder))
        self._texts = {name: (own, str(folder / f"{name}.py")) for name, own in _kept(text).items()}
        self._made: dict[str, ModuleType] = {}
        self._digest = hashlib.sha256(text.encode()).hexdigest()[:32]
        if "numba" in text:
            file_machine_code_by_text()

    def empty(self, name: str, file: str) -> ModuleType:
        """A module without content that imports kept modules from here."""
        # Machine code from disk looks for its module among those that are loaded, by this name.
        made = sys.modules[f"own_text_{name}"] = ModuleType(f"own_text_{name}")
        vars(made).update({"__file__": file, DIGEST: self._digest})
        if self._texts:
            vars(made)["__builtins__"] = vars(builtins) | {"__import__": self}
        return made

    def __call__(self, name: str, *words: Any, **more: Any) -> Any:
        """As `builtins.__import__`."""
        if name not in self._texts:
            return builtins.__import__(name, *words, **more)
        if name not in self._made:
            text, file = self._texts[name]
            made = self._made[name] = self.empty(name, file)
            try:
                exec(compile(text, file, "exec"), vars(made))
            except BaseException:
                del self._made[name]
                raise
        return self._made[name]


def file_machine_code_by_text() -> None:
    """Make numba keep it by a digest of the whole text.

    Numba goes by the file alone. A recorded law has none, and one with other data or another module beside it, or as it was when
    it was recorded, would run with machine code that holds other numbers.
    """
    from numba.core import caching  # Slow to load, and most texts do without.

    class ByText(caching._CacheLocator):
        """A place for the functions of texts, and for no others."""

        def __init__(self, function: Any):
            self._digest, code = function.__globals__[DIGEST], function.__code__
            self._name = f"{function.__module__}-{code.co_firstlineno}"

        @classmethod
        def from_function(cls, py_func: Any, py_file: str) -> "ByText | None":
            """None for other functions, or if the folder cannot be written: numba then looks for another place."""
            if DIGEST not in py_func.__globals__:
                return None
            found = cls(py_func)
            try:
                found.ensure_cache_path()
            except OSError:
                return None
            return found

        def get_cache_path(self) -> str:
            """The folder of the text."""
            return str(code_cache() / OWN_TEXTS / self._digest)

        def get_source_stamp(self) -> str:
            """The digest of the text."""
            return self._digest

        def get_disambiguator(self) -> str:
            """Module and line of the function."""
            return self._name

    known = caching.CompileResultCacheImpl._locator_classes
    if not any(one.__name__ == ByText.__name__ for one in known):
        known.insert(0, ByText)
