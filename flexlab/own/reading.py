"""Reads what a person's file declares without running it: one class, and the numbers that stand in its attributes."""

import ast
import hashlib
import operator
import re
from collections.abc import Callable, Iterator
from typing import Any

from flexlab.errors import ScenarioError
from flexlab.text import syntax_tree, visible

LONGEST_SOURCE = 200_000
"""Characters of a text."""


WORDS = r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])"
"""Where a class's name has its words' bounds."""


def kind_of(name: str) -> str:
    """The name in scenarios of a class: SoftPD becomes soft-pd, PIDControl pid-control."""
    return re.sub(WORDS, "-", name).replace("_", "-").lower()


def digest(source: str) -> str:
    """What tells one source from another."""
    return hashlib.sha256(source.encode()).hexdigest()[:16]


def is_finite(value: Any) -> bool:
    """Whether a value is a number that one can compute with."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300


def called(node: ast.AST) -> str:
    """The last part of a name, "gain" of `flexlab.gain`."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


_ARITHMETIC: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}


class DeclaredClass:
    """The one class of a text that inherits from `base`; knows the numbers that stand above it."""

    def __init__(self, source: str, file: str, base: str, field: str):
        """`field`: of the scenario, for what is wrong. Raises `ScenarioError` with file and line."""
        self._file, self._field = file, field
        if len(source) > LONGEST_SOURCE:
            raise self.problem(1, f"has {len(source)} characters: keep it under {LONGEST_SOURCE}")
        try:
            tree = syntax_tree(source)
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            line = getattr(error, "lineno", None) or 1
            raise self.problem(line, f"is no Python text ({getattr(error, 'msg', None) or error})") from None
        found = [node for node in tree.body if isinstance(node, ast.ClassDef) and base in map(called, node.bases)]
        if len(found) != 1:
            what = "no class" if not found else f"{len(found)} classes"
            line = found[1].lineno if found else 1
            raise self.problem(line, f"has {what} that inherit from {base}: write one class Name({base}): in a file")
        self.node = found[0]
        self.line: int = self.node.lineno
        self.meaning = visible(" ".join((ast.get_docstring(self.node) or self.node.name).split("\n\n")[0].split()))
        """First paragraph of its docstring."""
        self._known: dict[str, Any] = {}
        for node in tree.body:
            if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
                try:
                    self._known[node.targets[0].id] = self.value(node.value)
                except ScenarioError:
                    continue

    def problem(self, line: int, text: str) -> ScenarioError:
        """What is wrong, with file and line."""
        return ScenarioError([(self._field, f"{self._file}, line {line}: {text}.")])

    def attributes(self) -> Iterator[tuple[str, ast.expr]]:
        """(name, value) of the class's plain attributes."""
        for node in self.node.body:
            if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
                yield node.targets[0].id, node.value
            elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None:
                yield node.target.id, node.value

    def has_method(self, name: str) -> bool:
        """Whether the class defines a method."""
        return any(isinstance(node, ast.FunctionDef) and node.name == name for node in self.node.body)

    def few(self, what: str, count: int, most: int) -> None:
        """Raises `ScenarioError` for more than the most."""
        if count > most:
            raise self.problem(self.line, f"{self.node.name} declares {count} {what}: {most} are the most")

    def made(self, name: str, maker: Callable[..., Any], call: ast.Call) -> Any:
        """What a call in the text makes, `maker` being what it calls."""
        try:
            given = [self.value(item) for item in call.args]
            named = {item.arg or "**": self.value(item.value) for item in call.keywords}
            return maker(*given, **named)
        except TypeError as error:
            text = str(error).replace("()", "(...)")
            raise self.problem(call.lineno, f"{name}: {text}") from None

    def number(self, node: ast.expr, name: str, low: float, high: float, unit: str) -> float:
        """A number within a range."""
        value = self.value(node)
        if not is_finite(value) or not low <= value <= high:
            text = f"{name} = {value!r} is outside {low:g} to {high:g} {unit}: choose within it"
            raise self.problem(node.lineno, text)
        return float(value)

    def value(self, node: ast.expr) -> Any:
        """A number, text, or list of them that stands in the file, or that names and + - * / make of such."""
        if isinstance(node, ast.Constant):
            return visible(node.value) if isinstance(node.value, str) else node.value
        if isinstance(node, (ast.Tuple, ast.List)):
            return tuple(self.value(item) for item in node.elts)
        if isinstance(node, ast.Name) and node.id in self._known:
            return self._known[node.id]
        try:
            if isinstance(node, ast.UnaryOp) and type(node.op) in _ARITHMETIC:
                return _ARITHMETIC[type(node.op)](self.value(node.operand))
            if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
                first, second = self.value(node.left), self.value(node.right)
                if is_finite(first) and is_finite(second):
                    return _ARITHMETIC[type(node.op)](first, second)
        except (TypeError, ZeroDivisionError, OverflowError):
            pass
        text = ast.unparse(node)
        raise self.problem(
            node.lineno,
            f"{text[:60]} is not a number that stands in the file: declarations are read without running the file",
        )
