"""Registries of laws and paths: each is one file, found by looking into its folder."""

import hashlib
import importlib
import importlib.util
import pkgutil
import sys
import threading
from collections.abc import Callable
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Generic, Protocol, TypeVar


def modules_in(package: str) -> list[ModuleType]:
    """Every module of a package's folder, imported, by name."""
    folder = importlib.import_module(package)
    names = sorted(module.name for module in pkgutil.iter_modules(folder.__path__))
    return [importlib.import_module(f"{package}.{name}") for name in names]


def module_from_file(path: Path) -> ModuleType:
    """A Python file outside the package as a module. Raises what the file raises, and ImportError if it cannot be read."""
    # Every process must use the same name: machine code cached by an earlier one looks for its module by name.
    name = f"flexlab_file_{path.stem}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or not isinstance(spec.loader, SourceFileLoader):
        raise ImportError(f"{path} is not a Python file: give a file whose name ends in .py.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        # Python's cached bytecode would hide a change within the same second to a text of the same length.
        exec(spec.loader.source_to_code(path.read_bytes(), str(path)), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
    return module


class Kind(Protocol):
    """An entry of a registry."""

    @property
    def kind(self) -> str:
        """The name in scenarios."""
        ...

    @property
    def place(self) -> int:
        """Rank in menus."""
        ...


K = TypeVar("K", bound=Kind)


class Registry(Generic[K]):
    """Laws or paths by kind: those of a package's folder, read when first needed, and those that are added."""

    def __init__(self, sort: type[K], what: str, constant: str, package: str, lacks: Callable[[K], str] = lambda _: ""):
        """`what`: a word for one; `constant`: the name that a file gives it; `lacks`: a sentence on what an entry misses."""
        self.sort, self.what, self.constant = sort, what, constant
        self._package, self._lacks = package, lacks
        self._known: dict[str, K] = {}
        self._lock = threading.RLock()
        """Held while `_known` is replaced: else two threads could lose an entry or bring back a forgotten one."""
        self._built_in = False
        """Whether the package's entries have been read; users' own may be added before."""
        self._listeners: list[Callable[[], None]] = []

    def all(self) -> dict[str, K]:
        """All entries by kind, in menu order."""
        return dict(self._all())

    def __getitem__(self, kind: str) -> K:
        """The entry of a kind. Raises KeyError."""
        return self._all()[kind]

    def add(self, one: K, instead: bool = False) -> None:
        """Add an entry, `instead` of another of its kind. Raises ImportError if its name is taken or it lacks something."""
        self._enter(one, instead)
        self._tell()

    def add_file(self, file: str | Path) -> K:
        """Add the entry that a Python file defines. Raises ImportError, and whatever the file raises."""
        one = getattr(module_from_file(Path(file)), self.constant, None)
        if not isinstance(one, self.sort):
            raise ImportError(f"{file} defines no {self.what}: it needs {self.constant} = {self.sort.__name__}(...).")
        self._all()
        self.add(one)
        return one

    def forget(self, kind: str) -> None:
        """Remove an added entry."""
        with self._lock:
            self._known = {name: one for name, one in self._known.items() if name != kind}
        self._tell()

    def on_new(self, listener: Callable[[], None]) -> None:
        """Call `listener` whenever an entry has been added or removed."""
        self._listeners.append(listener)

    def _all(self) -> dict[str, K]:
        with self._lock:  # Other threads see the package's entries only once all are in.
            first, self._built_in = not self._built_in, True
            for module in modules_in(self._package) if first else ():
                self._enter(getattr(module, self.constant))
        if first:
            self._tell()
        return self._known

    def _enter(self, one: K, instead: bool = False) -> None:
        lacking = self._lacks(one)
        if lacking:
            raise ImportError(lacking)
        with self._lock:
            if not instead and one.kind in self._known and self._known[one.kind] != one:
                raise ImportError(f"Two {self.what}s are called {one.kind!r}: give one of them another kind.")
            # A new dictionary each time, as other threads may be reading the present one.
            known = {**self._known, one.kind: one}
            self._known = dict(sorted(known.items(), key=lambda item: (item[1].place, item[0])))

    def _tell(self) -> None:
        for listener in self._listeners:
            listener()
