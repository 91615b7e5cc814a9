"""The text of a class that was given as an object, complete, so that a recording can hold it."""

import ast
import inspect
import sys
import textwrap
from types import ModuleType
from typing import Any

from flexlab.own.declaration import OwnLaw
from flexlab.plain_text import PARSER, syntax_tree

HEADER = (
    "import math",
    "import flexlab",
    "import numpy as np",
    "from flexlab import OwnLaw, OwnPath, data_file, gain, memory, option, readout",
)
"""What the text of a class may take for granted."""
FUTURE = "__future__"


def class_text(given: type) -> str:
    """A class's text with those imports, constants, functions and classes of its file that it uses, each in its own line.

    A name that the file (or the notebook's cell) does not define is looked up in the class's module: modules, what can be
    imported, and numbers. Raises `OSError`, `TypeError` or `SyntaxError` where the text cannot be had.
    """
    with PARSER:
        own, first = inspect.getsourcelines(given)
        lines = inspect.findsource(given)[0]
    text = textwrap.dedent("".join(own))
    needed, kept, found = _loaded(syntax_tree(text)), {}, set()
    nodes = [node for node in syntax_tree("".join(lines)).body if not _is_main(node)]
    while new := [
        node for node in nodes if node.lineno not in kept and _bound(node) & needed and not _holds(node, first)
    ]:
        for node in new:
            kept[node.lineno] = node
            needed |= _loaded(node)
            found |= _bound(node)
    rows = [""] * len(lines)
    for node in kept.values():
        begin = min([node.lineno, *(one.lineno for one in getattr(node, "decorator_list", ()))]) - 1
        rows[begin : node.end_lineno] = [line.rstrip("\n") for line in lines[begin : node.end_lineno]]
    rows[first - 1 : first - 1 + len(own)] = text.rstrip("\n").split("\n")
    head = [f"from {FUTURE} import annotations"] * any(_is_future(node) for node in nodes)
    module = vars(sys.modules.get(given.__module__, ModuleType("")))
    head += [*HEADER, *(_definition(name, module[name]) for name in sorted(needed - found) if name in module)]
    # All in the first line, so that the others keep their numbers; one that holds a class or function has to move down.
    joint = "; " if 1 in kept and isinstance(kept[1], (ast.Import, ast.ImportFrom, ast.Assign)) else "\n"
    above = "; ".join(part for part in head if part)
    return (above + (joint + rows[0] if rows[0] else "") + "\n" + "\n".join(rows[1:])).rstrip("\n") + "\n"


def _loaded(tree: ast.AST) -> set[str]:
    """Names that a text uses."""
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Load)}


def _bound(node: ast.stmt) -> set[str]:
    """Names that a statement defines."""
    if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        return {node.name}
    if _is_future(node):
        return set()
    found = set()
    for part in ast.walk(node):
        if isinstance(part, ast.alias):
            found.add(part.asname or part.name.split(".")[0])
        elif isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store):
            found.add(part.id)
        elif isinstance(part, (ast.FunctionDef, ast.ClassDef)):
            found.add(part.name)
    return found


def _is_future(node: ast.stmt) -> bool:
    return isinstance(node, ast.ImportFrom) and node.module == FUTURE


def _is_main(node: ast.stmt) -> bool:
    """Whether a statement is what a file does when it is run by itself."""
    return isinstance(node, ast.If) and "__name__" in _loaded(node.test)


def _holds(node: ast.stmt, line: int) -> bool:
    """Whether a statement is the class itself, or what it is defined in."""
    return isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.lineno <= line <= (node.end_lineno or 0)


def _definition(name: str, value: Any) -> str:
    """A statement that defines a name of another cell or of a function's surroundings; empty if there is none."""
    if isinstance(value, ModuleType):
        return f"import {value.__name__} as {name}"
    if isinstance(value, (int, float)):
        return f"{name} = {int(value) if isinstance(value, int) else float(value)!r}"
    origin, known = getattr(value, "__module__", None), getattr(value, "__qualname__", "")
    if origin in (None, "__main__", "builtins") or getattr(sys.modules.get(origin), known, None) is not value:
        return ""
    if origin == OwnLaw.__module__:
        origin = "flexlab"  # Recordings outlive the modules in which public names stand.
    return f"from {origin} import {known} as {name}"
