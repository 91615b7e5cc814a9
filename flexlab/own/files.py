"""Files with laws or with paths in Python: those of a person's folder, the examples of flexlab, a given one, and classes."""

import contextlib
import inspect
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from flexlab.assets import presets_folder
from flexlab.control.law import Law
from flexlab.control.path import Path as DesiredPath
from flexlab.errors import ScenarioError
from flexlab.own import hosts
from flexlab.own.class_text import class_text
from flexlab.own.data import with_data
from flexlab.own.declaration import Declared, OwnLaw, OwnPath, read_declaration, read_path_declaration
from flexlab.own.elsewhere import address_in, is_address, is_unit, text_of_program
from flexlab.own.kinds import OwnKinds, default_source
from flexlab.own.law import OWN_LAWS
from flexlab.own.path import OWN_PATHS
from flexlab.own.unit import text_of_unit

K = TypeVar("K", bound=Law | DesiredPath)


def declares(text: str, base: str) -> bool:
    """Whether a Python text has a class that inherits from `base`, as it seems without reading it whole."""
    return re.search(rf"^class\s+\w+\s*\([^:]*\b{base}\b", text, re.MULTILINE) is not None


@dataclass(frozen=True)
class OwnFolder(Generic[K]):
    """The files with laws, or with paths, and what they hold."""

    folder: str
    """Its name, in a person's presets and in those of flexlab."""
    kinds: OwnKinds[K]
    base: type
    """The class that one inherits from."""
    declared: Callable[[str, str], Declared]
    """What a text declares: of text and file."""
    holding: str
    """What is in such a file."""
    example: str
    """The name of a built-in one."""
    _added: set[str] = field(default_factory=set)
    """Files that held a declared class."""
    _kernels: dict[str, str] = field(default_factory=dict)
    """File → kind of those that are kernels: a second one of that kind would be another one."""

    @property
    def own(self) -> Path:
        """A person's own folder, relative to the working directory."""
        return Path("presets") / self.folder

    def files(self) -> list[Path]:
        """All files, a person's own first; an example of flexlab gives way to an own file of its name."""
        found: dict[str, Path] = {}
        for folder in (self.own, presets_folder() / self.folder):
            for path in sorted([*folder.glob("*.py"), *folder.glob("*.fmu")]):
                if path.is_file():
                    found.setdefault(path.name, path)
        return list(found.values())

    def holds(self, file: str | Path) -> bool:
        """Whether a Python file holds such a class, or did when it was added."""
        if str(Path(file).resolve()) in self._added:
            return True
        try:
            return declares(self.text(Path(file)), self.base.__name__)
        except ScenarioError:
            return False

    def add(self, file: str | Path) -> K:
        """Make what a Python file declares known and let it run. Raises `ScenarioError`, with file and line."""
        place = str(Path(file).resolve())
        own = self.kinds.add(self.text(Path(file)), place)
        self._added.add(place)
        return own

    def add_all(self) -> list[str]:
        """Make what is in `files` known; returns a sentence for each that cannot be. No declared class runs by that."""
        problems = []
        for file in self.files():
            try:
                self.kind_of(file)
            except ScenarioError as error:
                problems.append(f"A {self.kinds.registry.what} is left out: {error}")
        return problems

    def kind_of(self, given: Any) -> str:
        """The kind of what is given by its name, by a Python file, as a class, or, of a law, by a program's address.

        Raises `ScenarioError`.
        """
        word, what, base = self.kinds.word, self.kinds.registry.what, self.base
        if is_address(given) and base is OwnLaw:
            text = text_of_program(given)
            return self.kinds.add(text, address_in(text)).kind
        if isinstance(given, Path) or (isinstance(given, str) and given.endswith((".py", ".fmu"))):
            kernel = self._kernel(Path(given))
            if not kernel and not self.holds(given):
                needed = f"it needs a class Name({base.__name__}), or {self._constant} = {word.capitalize()}(...)"
                raise self._problem("source", f"{given} holds no {what} that can be used: {needed}.")
            return kernel or self.add(given).kind
        if isinstance(given, type) and issubclass(given, base):
            return self.kinds.add(self._text_of(given), inspect.getsourcefile(given) or given.__name__).kind
        if not isinstance(given, str):
            advice = f"give a name such as {self.example}, a file, or a class of {base.__name__}"
            raise self._problem("kind", f"{word} = {given!r:.60} is no {what}: {advice}.")
        if given not in self.kinds.registry.all():
            for file in self.files():
                if self._declares(file, given):
                    return self.add(file).kind
        return given

    @property
    def _constant(self) -> str:
        return self.kinds.registry.constant

    def _problem(self, name: str, text: str) -> ScenarioError:
        return ScenarioError([(f"{self.kinds.field}.{name}", text)])

    def text(self, file: Path) -> str:
        """With the data that it names; of a unit, what it is as a law in Python. Raises `ScenarioError`."""
        if is_unit(file.name):
            return text_of_unit(file)
        try:
            return with_data(file.read_text(encoding="utf-8"), file.parent, f"{self.kinds.field}.source")
        except FileNotFoundError:
            text = f"There is no file {file}: give the path of a Python file with {self.holding}."
            raise self._problem("source", text) from None
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "it is no text in UTF-8"
            raise self._problem("source", f"{file} cannot be read: {why}.") from None

    def _kernel(self, file: Path) -> str:
        """The kind of what a file defines as a kernel (`LAW = Law(...)`), or nothing. Raises `ScenarioError`."""
        if not re.search(rf"^{self._constant}\s*=", self.text(file), re.MULTILINE):
            return ""
        place = str(file.resolve())
        if self._kernels.get(place) not in self.kinds.registry.all():
            try:
                self._kernels[place] = self.kinds.registry.add_file(file).kind
            except Exception as error:
                text = f"{file.name} cannot be used ({type(error).__name__}: {error})."
                raise self._problem("kind", text) from None
        return self._kernels[place]

    def _declares(self, file: Path, kind: str) -> bool:
        try:
            return self.declared(self.text(file), file.name).kind == kind
        except ScenarioError:
            return False

    def _text_of(self, given: type) -> str:
        """Raises `ScenarioError`."""
        if self.base not in given.__bases__:
            what = f"The class {given.__name__} inherits from {self.base.__name__} through another class: inherit directly."
            raise self._problem("source", what)
        try:
            folder = Path(inspect.getsourcefile(given) or "").resolve().parent
            return with_data(class_text(given), folder if folder.is_dir() else Path(), f"{self.kinds.field}.source")
        except (OSError, TypeError, SyntaxError):
            what = (
                f"The text of the class {given.__name__} cannot be found, which a recording needs: write it in a file."
            )
            raise self._problem("source", what) from None


LAW_FILES = OwnFolder("laws", OWN_LAWS, OwnLaw, read_declaration, "a control law", "pd")
law_files, law_kind, add_own_law_file = LAW_FILES.files, LAW_FILES.kind_of, LAW_FILES.add
PATH_FILES = OwnFolder("paths", OWN_PATHS, OwnPath, read_path_declaration, "a desired motion", "circle")
path_files, path_kind, add_own_path_file = PATH_FILES.files, PATH_FILES.kind_of, PATH_FILES.add


def own_texts() -> list[tuple[str, str]]:
    """(text, file) of the laws and paths in Python that are known and may run here, for another machine."""
    known = [*OWN_LAWS.known(), *OWN_PATHS.known()]
    return [(text, hosts.file_of(text)) for text in map(default_source, known) if hosts.is_allowed(text)]


def know_own_texts(texts: Collection[tuple[str, str]]) -> None:
    """Know what `own_texts` told on another machine, and let it run in processes of its own."""
    if texts:
        hosts.run_apart()
    for text, file in texts:
        (OWN_PATHS if declares(text, "OwnPath") else OWN_LAWS).add(text, file)


def know_own_files(allowed: dict[str, str]) -> None:
    """Let run what that process allows (`hosts.allowed`), in processes of their own; know its files."""
    hosts.run_apart()
    hosts.allow_digests(allowed)
    for file in dict.fromkeys(allowed.values()):
        if Path(file).is_file():
            with contextlib.suppress(ScenarioError):  # Said already by the process that allows it.
                (PATH_FILES if PATH_FILES.holds(file) else LAW_FILES).add(file)
