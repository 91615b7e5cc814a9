"""Where laws and paths come from: a person's folder, flexlab's examples, a given file, or a class."""

import contextlib
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

from flexlab.assets import presets_folder
from flexlab.control.law import Law
from flexlab.control.path import Path as DesiredPath
from flexlab.errors import ScenarioError
from flexlab.files import check_ordinary
from flexlab.own import hosts
from flexlab.own.class_text import class_file, class_text
from flexlab.own.declaration import OwnLaw, OwnPath
from flexlab.own.kinds import OwnKinds, default_source
from flexlab.own.law import OWN_LAWS
from flexlab.own.link import address_in, text_of_program
from flexlab.own.modules import kept_files, with_modules
from flexlab.own.path import OWN_PATHS
from flexlab.own.reading import LONGEST_SOURCE, is_address, is_unit
from flexlab.own.unit import text_of_unit

LARGEST = 4 * LONGEST_SOURCE
"""The most bytes of a file: a character has four at most."""
RENAMED = {
    "'carry'": "'bumpless_transfer'", "flexlab.control.load_sharing": "flexlab.control.law_kernels",
    "flexlab.control.row_search": "flexlab.control.paths.table",
    "flexlab.control.observers.kalman": "flexlab.control.observers.observer",
}  # fmt: skip
"""Names in kernels of version 0.2.0, as Python's error quotes them, and the present names."""
K = TypeVar("K", bound=Law | DesiredPath)


def declares(text: str, base: str) -> bool:
    """Whether a text seems to have a class that inherits from `base`; it is not parsed."""
    return re.search(rf"^class\s+\w+\s*\([^:]*\b{base}\b", text, re.MULTILINE) is not None


ENDINGS = (".py", ".fmu")
"""Ends of the names of a person's own files: texts in Python, and units."""


def files_in(folder: Path) -> list[Path]:
    """All such files of a folder."""
    return sorted(path for ending in ENDINGS for path in folder.glob(f"*{ending}"))


@dataclass(frozen=True)
class OwnFolder(Generic[K]):
    """The files with laws, or with paths."""

    kinds: OwnKinds[K]
    base: type
    """`OwnLaw` or `OwnPath`."""
    example: str
    """The name of a built-in one."""
    _added: set[str] = field(default_factory=set)
    """Files that were added."""
    _kernels: dict[str, str] = field(default_factory=dict)
    """File → kind of a law that is a kernel; each is loaded once."""

    @property
    def own(self) -> Path:
        """A person's own folder, relative to the working directory."""
        return Path("presets") / f"{self.kinds.word}s"

    def files(self) -> list[Path]:
        """All files, a person's own first; they replace flexlab's examples of the same name."""
        found: dict[str, Path] = {}
        for folder in (self.own, presets_folder() / self.own.name):
            for path in files_in(folder):
                if path.is_file():
                    found.setdefault(path.name, path)
        return list(found.values())

    def holds(self, file: str | Path) -> bool:
        """Whether a file has such a class, or was added before."""
        if self.knows(file):
            return True
        try:
            return declares(self.text(Path(file)), self.base.__name__)
        except ScenarioError:
            return False

    def has_kernel(self, file: Path) -> bool:
        """Whether a kernel of this file is known."""
        return self._kernels.get(str(file.resolve())) in self.kinds.registry.all()

    def knows(self, file: str | Path) -> bool:
        """Whether a file was added before."""
        return str(Path(file).resolve()) in self._added

    def add(self, file: str | Path) -> K:
        """Make a file's law or path known and let it run. Raises `ScenarioError` with file and line."""
        place = str(Path(file).resolve())
        own = self.kinds.add(self.text(Path(file)), place)
        self._added.add(place)
        return own

    def add_all(self) -> list[str]:
        """Make all `files` known, without running a declared class; return a sentence for each file that cannot be used."""
        problems = []
        for file in self.files():
            try:
                self.kind_of(file)
            except ScenarioError as error:
                if not self.is_part(file):
                    problems.append(f"A {self.kinds.registry.what} is left out: {error}")
        return problems

    def parts(self, file: Path) -> frozenset[Path]:
        """The modules and data files beside a file that its text contains; none if it cannot be read."""
        try:
            return frozenset(file.parent / name for name in kept_files(self.text(file)))
        except ScenarioError:
            return frozenset()

    def is_part(self, file: Path) -> bool:
        """Whether a file beside this one has it as a module, and it is nothing else."""
        return not self.holds(file) and any(file in self.parts(one) for one in file.parent.glob("*.py"))

    def kind_of(self, given: Any) -> str:
        """The kind of a law or path given by name, as a file, a class or the address of a program. Raises `ScenarioError`."""
        word, what, base = self.kinds.word, self.kinds.registry.what, self.base
        if is_address(given) and base is OwnLaw:
            text = text_of_program(given)
            return self.kinds.add(text, address_in(text)).kind
        if isinstance(given, Path) or (isinstance(given, str) and given.endswith(ENDINGS)):
            kernel = self._kernel(Path(given))
            if not kernel and not self.holds(given):
                needed = f"it needs a class Name({base.__name__}), or {self.kinds.registry.constant} = {word.capitalize()}(...)"
                raise self._problem("source", f"{given} holds no {what} that can be used: {needed}.")
            return kernel or self.add(given).kind
        if isinstance(given, type) and issubclass(given, base):
            return self.kinds.add(self._text_of(given), str(class_file(given) or given.__name__)).kind
        if not isinstance(given, str):
            advice = f"give a name such as {self.example}, a file, or a class of {base.__name__}"
            raise self._problem("kind", f"{word} = {given!r:.60} is not a {what}: {advice}.")
        if given not in self.kinds.registry.all():
            for file in self.files():
                if self._declares(file, given):
                    return self.add(file).kind
        return given

    def kinds_of(self, given: Sequence[Any]) -> list[Any]:
        """The kinds of several files or classes that are to be compared; anything else as it is.

        Raises `ScenarioError`, also if two that differ have the same name: only the last would be known by it.
        """
        found, texts = list[Any](), dict[str, Any]()
        for one in given:
            kind = self.kind_of(one) if isinstance(one, (str, Path, type)) else one
            own = self.kinds.registry.all().get(kind) if isinstance(kind, str) else None
            if isinstance(own, self.kinds.sort) and texts.setdefault(kind, default_source(own)) != default_source(own):
                what = self.kinds.registry.what
                raise self._problem("kind", f"Two {what}s are called {kind}: give one of the classes another name.")
            found.append(kind)
        return found

    def _problem(self, name: str, text: str) -> ScenarioError:
        return ScenarioError([(f"{self.kinds.field}.{name}", text)])

    def text(self, file: Path) -> str:
        """The text of a file with the data files that it names, or the text made from a unit. Raises `ScenarioError`."""
        if is_unit(file.name):
            return text_of_unit(file)
        try:
            check_ordinary(file)
            if file.exists() and file.stat().st_size > LARGEST:
                raise self._problem(
                    "source", f"{file} is larger than {LARGEST / 1e6:g} MB, too large for a {self.kinds.word}."
                )
            return with_modules(file.read_text(encoding="utf-8-sig"), file.parent, f"{self.kinds.field}.source")
        except FileNotFoundError:
            text = f"There is no file {file}: give the path of a Python file with a {self.kinds.registry.what}."
            raise self._problem("source", text) from None
        except (OSError, ValueError) as error:
            named = "it is not text in UTF-8" if isinstance(error, UnicodeDecodeError) else "no file has such a name"
            why = error.strerror if isinstance(error, OSError) else named
            raise self._problem("source", f"{file} cannot be read: {why}.") from None

    def _kernel(self, file: Path) -> str:
        """The kind of a file that defines a kernel (`LAW = Law(...)`); empty for any other. Raises `ScenarioError`."""
        if not re.search(rf"^{self.kinds.registry.constant}\s*=", self.text(file), re.MULTILINE):
            return ""
        place = str(file.resolve())
        if not self.has_kernel(file):
            try:
                self._kernels[place] = self.kinds.registry.add_file(file).kind
            except Exception as error:
                renamed = (f" {old} is called {new} now." for old, new in RENAMED.items() if old in str(error))
                text = f"{file.name} cannot be used ({type(error).__name__}: {error}).{next(renamed, '')}"
                raise self._problem("kind", text) from None
        return self._kernels[place]

    def _declares(self, file: Path, kind: str) -> bool:
        try:
            return self.kinds.read(self.text(file), file.name, "").kind == kind
        except ScenarioError:
            return False

    def _text_of(self, given: type) -> str:
        """The text of a class, with the data files that it names. Raises `ScenarioError`."""
        if self.base not in given.__bases__:
            what = f"The class {given.__name__} inherits from {self.base.__name__} through another class: inherit directly."
            raise self._problem("source", what)
        try:
            file = class_file(given)
            folder = file.resolve().parent if file else Path()
            return with_modules(class_text(given), folder, f"{self.kinds.field}.source")
        except ValueError as error:
            raise self._problem("source", str(error)) from None
        except (OSError, TypeError, SyntaxError):
            what = (
                f"The text of the class {given.__name__} cannot be found, which a recording needs: write it in a file."
            )
            raise self._problem("source", what) from None


LAW_FILES, PATH_FILES = OwnFolder(OWN_LAWS, OwnLaw, "pd"), OwnFolder(OWN_PATHS, OwnPath, "circle")
law_kind, path_kind = LAW_FILES.kind_of, PATH_FILES.kind_of


def own_texts() -> list[tuple[str, str]]:
    """(text, file) of the known laws and paths that may run, for another machine."""
    known = [*OWN_LAWS.known(), *OWN_PATHS.known()]
    return [(text, hosts.file_of(text)) for text in map(default_source, known) if hosts.is_allowed(text)]


def know_own_texts(texts: Collection[tuple[str, str]]) -> None:
    """Make the `own_texts` of another machine known, and run them in processes of their own."""
    if texts:
        hosts.run_apart()
    for text, file in texts:
        (OWN_PATHS if declares(text, "OwnPath") else OWN_LAWS).add(text, file)


def know_own_files(allowed: dict[str, str]) -> None:
    """Allow the texts that another process allows (`hosts.allowed`), run apart, and make their files known."""
    hosts.run_apart()
    hosts.allow_digests(allowed)
    for file in dict.fromkeys(allowed.values()):
        if Path(file).is_file():
            with contextlib.suppress(ScenarioError):  # The other process has said why.
                (PATH_FILES if PATH_FILES.holds(file) else LAW_FILES).add(file)
