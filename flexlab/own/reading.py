"""Reads a person's text without running it: its one class, and the numbers written in its attributes.

Data files beside it, such as the weights of a network, become a part of the text: recordings, archives, replays and other
machines then have them, and whoever is asked whether a text may run sees all that will run.
"""

import ast
import base64
import contextlib
import io
import operator
import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from flexlab.errors import ScenarioError
from flexlab.text import range_text, syntax_tree, visible

LONGEST_SOURCE = 200_000
"""Characters of a text."""
LONGEST_CLASS = 200
"""Characters of a class's name, which stands in menus and sentences."""
SCHEME = "tcp://"
"""How the address of a program that computes a law begins."""
WORDS = r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])"
"""Boundaries between the words of a class's name."""
_ARITHMETIC: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
MOST_DATA = LONGEST_SOURCE * 5 // 8
"""Bytes of a data file; in base64 they need a third more, and the law itself needs room."""
_KEPT = re.compile(
    r'(data_file\(\s*"[^"\\]{1,200}"), "((?:[A-Za-z0-9+/]{4})*(?:[A-Za-z0-9+/]{2}==|[A-Za-z0-9+/]{3}=)?)"\)'
)


class TextProblem(Exception):
    """What is wrong with a text, as a sentence with file and line."""


def is_address(given: Any) -> bool:
    """Whether a law is given as the address of a program."""
    return isinstance(given, str) and given.lower().startswith(SCHEME)


def is_unit(file: str) -> bool:
    """Whether a file is a functional mock-up unit, by its name."""
    return file.lower().endswith(".fmu")


def is_foreign(file: str) -> bool:
    """Whether a law's `file` is a program or a unit: the lines of its text then mean nothing to a person."""
    return is_address(file) or is_unit(file)


def kind_of(name: str) -> str:
    """A class's name in scenarios: SoftPD becomes soft-pd, PIDControl pid-control."""
    return re.sub(WORDS, "-", name).replace("_", "-").lower()


def is_finite(value: Any) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300


def called(node: ast.AST) -> str:
    """The last part of a dotted name: "gain" of `flexlab.gain`."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def assigned(body: Iterable[ast.stmt]) -> Iterator[tuple[str, ast.expr]]:
    """Name and value of each plain assignment in a class or a file."""
    for node in body:
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if len(targets) == 1 and isinstance(targets[0], ast.Name):
                yield targets[0].id, node.value


class DeclaredClass:
    """The one class of a text that inherits from `base`, and the constants defined above it."""

    def __init__(self, source: str, file: str, base: str, field: str):
        """`field`: the scenario's field that errors name. Raises `ScenarioError` with file and line."""
        self._file, self._field = file, field
        if len(source) > LONGEST_SOURCE:
            raise self.problem(1, f"the file has {len(source)} characters: keep it under {LONGEST_SOURCE}")
        try:
            tree = syntax_tree(source)
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            line = getattr(error, "lineno", None) or 1
            reason = getattr(error, "msg", None) or str(error) or "it is nested too deeply"
            raise self.problem(line, f"this is not valid Python ({reason})") from None
        found = [node for node in tree.body if isinstance(node, ast.ClassDef) and base in map(called, node.bases)]
        if len(found) != 1:
            what = "no class that inherits from" if not found else f"{len(found)} classes that inherit from"
            line = found[1].lineno if found else 1
            raise self.problem(line, f"the file has {what} {base}: write one class Name({base}): in a file")
        self.node = found[0]
        self.mistake = ""
        """The first reason, with its line, why a person's file is refused although recordings with such a text open."""
        for node in tree.body:  # Python would take it for the law, and not the class that it inherits from.
            if isinstance(node, ast.ClassDef) and self.node.name in map(called, node.bases):
                self.note(node.lineno, f"{node.name} inherits from {base} through another class: inherit directly")
        if len(self.node.name) > LONGEST_CLASS:
            text = f"the name of the class has {len(self.node.name)} characters: {LONGEST_CLASS} are the most"
            self.note(self.node.lineno, text)
        self.line: int = self.node.lineno
        meaning = visible(" ".join((ast.get_docstring(self.node) or self.node.name).split("\n\n")[0].split()))
        self.about = self.node.name, self.line, meaning
        """Its name, line, and the first paragraph of its docstring."""
        self.attributes = dict(assigned(self.node.body))
        """Name → value of its plain attributes; as in Python, the last value counts."""
        self._known: dict[str, Any] = {}
        for name, value in assigned(tree.body):
            with contextlib.suppress(ScenarioError):
                self._known[name] = self.value(value)

    def problem(self, line: int, text: str) -> ScenarioError:
        """An error with file and line."""
        return ScenarioError([(self._field, f"{self._file}, line {line}: {text}.")])

    def note(self, line: int, text: str) -> None:
        """Note a `mistake`: every rule that is younger than recordings is checked this way, so that they still open."""
        self.mistake = self.mistake or f"line {line}: {text}"

    def keeps(self, settings: Collection[str], instead: str) -> None:
        """Note a statement in a method that sets one of the `settings`: its value would be lost at the next call."""
        for line, name in sorted(place for method in self.node.body for place in _set_in(method)):
            if name in settings:
                self.note(line, f"no method can change {name}, which has the value that the scenario sets: {instead}")

    def has_method(self, name: str) -> bool:
        """Whether the class defines a method."""
        return any(isinstance(node, ast.FunctionDef) and node.name == name for node in self.node.body)

    def few(self, what: str, count: int, most: int) -> None:
        """Raise `ScenarioError` if `count` is above `most`."""
        if count > most:
            raise self.problem(self.line, f"{self.node.name} declares {count} {what}: {most} are the most")

    def made(self, name: str, value: ast.expr, makers: Mapping[str, Callable[..., Any]]) -> Any:
        """The result of the attribute's `value` if it is a call of one of `makers`, by their names; else None."""
        if not isinstance(value, ast.Call) or (maker := makers.get(called(value.func))) is None:
            return None
        try:
            given = [self.value(item) for item in value.args]
            named = {item.arg or "**": self.value(item.value) for item in value.keywords}
            return maker(*given, **named)
        except TypeError as error:
            text = str(error).replace("()", "(...)")
            raise self.problem(value.lineno, f"{name}: {text}") from None

    def number(self, node: ast.expr, name: str, low: float, high: float, unit: str) -> float:
        """A number within a range."""
        value = self.value(node)
        if not is_finite(value) or not low <= value <= high:
            text = f"{name} = {value!r} is outside {range_text(low, high)} {unit}: choose within it"
            raise self.problem(node.lineno, text)
        return float(value)

    def value(self, node: ast.expr) -> Any:
        """A number, a text or a list written in the file, or computed from such by + - * /. Raises `ScenarioError`."""
        if isinstance(node, ast.Constant):
            return visible(" ".join(node.value.split())) if isinstance(node.value, str) else node.value
        if isinstance(node, (ast.Tuple, ast.List)):
            return tuple(self.value(item) for item in node.elts)
        if isinstance(node, ast.Name) and node.id in self._known:
            return self._known[node.id]
        try:
            with contextlib.suppress(TypeError, ZeroDivisionError, OverflowError):
                if isinstance(node, ast.UnaryOp) and type(node.op) in _ARITHMETIC:
                    return _ARITHMETIC[type(node.op)](self.value(node.operand))
                if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
                    first, second = self.value(node.left), self.value(node.right)
                    if is_finite(first) and is_finite(second):
                        return _ARITHMETIC[type(node.op)](first, second)
            text = ast.unparse(node)[:60]
        except RecursionError:
            text = "an expression of so many parts"
        raise self.problem(
            node.lineno,
            f"{text} is not a number written in the file: declarations are read without running the file",
        )


def _set_in(method: ast.stmt) -> Iterator[tuple[int, str]]:
    """Line and name of each attribute of its object that a method sets, wholly or in part."""
    own = method.args.args[0].arg if isinstance(method, ast.FunctionDef) and method.args.args else None
    for node in ast.walk(method):
        target: ast.AST = node
        if not isinstance(getattr(node, "ctx", ast.Load()), ast.Load):
            while isinstance(target, ast.Subscript):
                target = target.value
            if isinstance(target, ast.Attribute) and isinstance(target.value, ast.Name) and target.value.id == own:
                yield target.lineno, target.attr


def data_file(name: str, kept: str | None = None) -> io.BytesIO:
    """The contents of a file beside the law or path, up to 125 kB, as for `np.load(data_file("weights.npz"))`.

    flexlab adds `kept`, the file's bytes in base64, when it reads the law, so that recordings are complete. Raises `OSError`
    if there is no such file.
    """
    try:
        if kept is not None:
            return io.BytesIO(base64.b64decode(kept))
        beside = sys._getframe(1).f_globals.get("__file__", "")
        return io.BytesIO((Path(beside).parent / name).read_bytes())
    except (TypeError, ValueError):
        raise OSError(f"data_file({name!r:.80}): give the name of a file in the same folder") from None


def with_data(text: str, folder: Path, field: str) -> str:
    """A text with the contents of the data files in `folder` that it names. Lines keep their numbers.

    `field`: the scenario's field that errors name. Raises `ScenarioError` for a file that cannot be kept.
    """
    if "data_file" not in text:
        return text
    try:
        tree = syntax_tree(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return text  # Reading its declarations raises the error.
    lines = text.split("\n")
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and called(node.func) == "data_file"]
    # From the end, so that the places before stay valid.
    for call in sorted(calls, key=lambda node: (node.lineno, node.col_offset), reverse=True):
        if any(keyword.arg in ("name", "kept") for keyword in call.keywords):
            raise _problem(field, call, "data_file needs the name of a file without name= before it")
        if len(call.args) != 1 or call.keywords:
            continue
        name = call.args[0]
        if not isinstance(name, ast.Constant) or not isinstance(name.value, str) or name.end_lineno is None:
            raise _problem(field, call, "data_file needs the name of a file, written out")
        line = lines[name.end_lineno - 1].encode()
        kept = f", {_encoded(name.value, folder, field, call)!r}".replace("'", '"').encode()
        lines[name.end_lineno - 1] = (line[: name.end_col_offset] + kept + line[name.end_col_offset :]).decode()
    return "\n".join(lines)


def data_names(text: str) -> list[str]:
    """The names of the data files that a text of `with_data` has."""
    return [found[1].split('"')[1] for found in _KEPT.finditer(text)]


def without_data(text: str) -> str:
    """A text for people, with the size of its data in place of the data."""
    return _KEPT.sub(lambda found: f'{found[1]}, "{len(base64.b64decode(found[2]))} bytes")', text)


def _encoded(name: str, folder: Path, field: str, call: ast.Call) -> str:
    file = folder / name
    try:
        if not name or Path(name).name != name or file.is_symlink():
            raise _problem(field, call, f"data_file({name!r:.80}): give the name of a file in the same folder")
        if not file.is_file():
            raise _problem(field, call, f"data_file({name!r:.80}): there is no such file in {folder}")
        if file.stat().st_size > MOST_DATA:
            size = file.stat().st_size
            raise _problem(field, call, f"data_file({name!r:.80}): it has {size} bytes, {MOST_DATA} are the most")
        return base64.b64encode(file.read_bytes()).decode()
    except OSError as error:
        raise _problem(field, call, f"data_file({name!r:.80}): it cannot be read ({error.strerror})") from None


def _problem(field: str, call: ast.Call, text: str) -> ScenarioError:
    return ScenarioError([(field, f"Line {call.lineno}: {text}.")])
