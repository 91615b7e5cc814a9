"""The text of a law or path that is given as a class, with everything that it uses, so that a recording can hold it."""

import ast
import cmath
import dis
import inspect
import linecache
import sys
import textwrap
from collections import Counter
from contextlib import suppress
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import numpy as np

from flexlab.own.declaration import LASTING, OwnLaw
from flexlab.own.reading import assigned
from flexlab.text import PARSER, syntax_tree

HEADER = (
    "import math",
    "import flexlab",
    "import numpy as np",
    "from flexlab import OwnLaw, OwnPath, data_file, gain, memory, option, readout",
)
"""Imports at the head of a class's text."""
FUTURE = "__future__"
LOADS = ("LOAD_NAME", "LOAD_GLOBAL", "LOAD_FROM_DICT_OR_GLOBALS")
"""Python's instructions that look a name up in the file; the last from Python 3.12 on."""


SIZED = (str, list, tuple, dict)
NUMBERS = "biufc"
"""Kinds of numpy's types that are numbers."""
DECLARED = (*LASTING, "on_save")
"""Attributes of a class that are read from its text."""
LONGEST_INTEGER = 1000
"""Bits of a number that is written out."""
MOST_ITEMS = 2000
"""The most numbers and texts of a value that is written out; longer ones are computed again by the file's own statements."""


def class_text(given: type) -> str:
    """A class's text with the imports, constants, functions and classes of its file that it uses; lines keep their numbers.

    Numbers, texts, arrays and lists of these have their present values, however the file or another notebook's cell computed
    them; so are modules and what can be imported from elsewhere. Raises `OSError`, `TypeError` or `SyntaxError` if the text
    cannot be found, and `ValueError` with a sentence for a changed attribute that the text cannot have.
    """
    with PARSER:
        lines = inspect.findsource(_written_in(given))[0]
    own, first = _lines_of(given, lines)
    text = textwrap.dedent("".join(own))
    nodes = [node for node in syntax_tree("".join(lines)).body if not (_is_main(node) or _runs(node, given.__name__))]
    module, enclosed = vars(sys.modules.get(given.__module__, ModuleType(""))), _enclosed(given)
    written, defined = _written(nodes, module), dict[str, str]()
    kept, others, done = dict[int, ast.stmt](), dict[str, None](), set(enclosed)
    waiting = sorted(_used(_compiled(syntax_tree(text).body)), reverse=True)
    while waiting:
        name = waiting.pop()
        if name in done:
            continue
        done.add(name)
        if name in module and name not in written and (value := _expression(module[name])):
            defined[name] = f"{name} = {value}"
            continue
        here = {node.lineno: node for node in nodes if name in _bound(node) and not _holds(node, first)}
        elsewhere = [] if here else _in_another_cell(name, module, given)
        if name in module and not here and not elsewhere:
            defined[name] = _definition(name, module[name])
        kept |= here
        others = dict.fromkeys(map(ast.unparse, elsewhere)) | others
        for node in (*here.values(), *elsewhere):
            waiting += sorted(_used(_compiled([node])), reverse=True)
    rows = [""] * len(lines)
    for node in kept.values():
        begin = min([node.lineno, *(one.lineno for one in getattr(node, "decorator_list", ()))]) - 1
        rows[begin : node.end_lineno] = [line.rstrip("\n") for line in lines[begin : node.end_lineno]]
    rows[first - 1 : first - 1 + len(own)] = text.rstrip("\n").split("\n")
    head = [f"from {FUTURE} import annotations"] * any(_is_future(node) for node in nodes)
    head += [*HEADER, *enclosed.values(), *(defined[name] for name in sorted(defined))]
    # The head goes into the first line, so that lines keep their numbers, unless that line begins a class or function.
    joint = "; " if 1 in kept and isinstance(kept[1], (ast.Import, ast.ImportFrom, ast.Assign)) else "\n"
    above = "; ".join(part for part in head if part)
    whole = (above + (joint + rows[0] if rows[0] else "") + "\n" + "\n".join(rows[1:])).rstrip("\n") + "\n"
    whole += "".join(f"\n\n{statement}\n" for statement in others)
    return whole + "".join(f"{given.__name__}.{name} = {value}\n" for name, value in _changed(given, text).items())


def class_file(given: type) -> Path | None:
    """The file in which a class is written; None for a notebook's cell. Raises `OSError` or `TypeError` if it is unknown."""
    file = Path(inspect.getfile(_written_in(given)))
    return file if file.is_file() else None


def _written_in(given: type) -> Any:
    """A method of the class, as Python knows the notebook's cell of functions alone; the class itself if it has none."""
    own = (inspect.unwrap(one) for one in vars(given).values() if inspect.isfunction(one))
    for one in own:
        is_own = one.__module__ == given.__module__ and one.__qualname__.startswith(f"{given.__qualname__}.")
        if is_own and linecache.getlines(one.__code__.co_filename):  # Not one that a decorator made.
            return one
    return given


def _lines_of(given: type, lines: list[str]) -> tuple[list[str], int]:
    """The lines of a class among those of its file or cell, and the number of the first. Raises `OSError` if it is not there."""
    line = getattr(getattr(_written_in(given), "__code__", None), "co_firstlineno", None)
    for node in reversed(list(ast.walk(syntax_tree("".join(lines))))):
        if isinstance(node, ast.ClassDef) and node.name == given.__name__ and (line is None or _holds(node, line)):
            first = min(one.lineno for one in (node, *node.decorator_list))
            return lines[first - 1 : node.end_lineno], first
    raise OSError(given.__name__)


def _in_another_cell(name: str, module: dict[str, Any], given: type) -> list[ast.stmt]:
    """The statements with which another cell of the notebook defines a function or class; none for anything else."""
    value = module.get(name)
    if getattr(value, "__module__", None) != given.__module__ or _definition(name, value):
        return []
    try:
        with PARSER:
            lines = inspect.findsource(_written_in(value) if isinstance(value, type) else inspect.unwrap(value))[0]
        return [node for node in syntax_tree("".join(lines)).body if name in _bound(node)]
    except (OSError, TypeError, SyntaxError):
        return []


def _enclosed(given: type) -> dict[str, str]:
    """Name → definition of the variables, of the function in which a class was made, that its methods use.

    Raises `ValueError` for one that cannot be written.
    """
    found: dict[str, str] = {}
    for method in vars(given).values():
        code, cells = getattr(method, "__code__", None), getattr(method, "__closure__", None)
        for name, cell in zip(code.co_freevars, cells, strict=True) if code and cells else ():
            with suppress(ValueError):  # It has no value yet.
                value = cell.cell_contents
                expression = _expression(value)
                found[name] = f"{name} = {expression}" if expression else _definition(name, value)
    found.pop("__class__", None)
    if lost := [name for name, definition in found.items() if not definition]:
        variable = f"{given.__name__} uses {lost[0]}, a variable of the function that made it"
        raise ValueError(f"{variable}, of which a recording cannot keep the value: define it in the file itself.")
    return found


def _changed(given: type, text: str) -> dict[str, str]:
    """Name → present value of the plain attributes of a class that its text does not write out, or that were changed since."""
    body = next(node.body for node in syntax_tree(text).body if isinstance(node, ast.ClassDef))
    literal: dict[str, str] = {}
    for name, value in assigned(body):
        with suppress(ValueError):
            literal[name] = _expression(ast.literal_eval(value))
    present = {name: _expression(value) for name, value in vars(given).items() if not name.startswith("__")}
    changed = {name: value for name, value in present.items() if value and literal.get(name) != value}
    if lost := sorted(changed.keys() & literal.keys() & set(DECLARED)):
        raise ValueError(f"{given.__name__}.{lost[0]} was changed after the class was made: write it into the class.")
    return changed


def _written(nodes: list[ast.stmt], module: dict[str, Any]) -> set[str]:
    """The names whose present values one statement of constants alone gives, as it stands in the file."""
    bound = Counter(name for node in nodes for name in _bound(node))
    names: dict[str, Any] = {}
    for node in nodes:
        if isinstance(node, ast.Assign) and not _used(_compiled([node])):
            exec(compile(ast.Module([node], []), "", "exec"), {}, names)
    return {name for name in names if bound[name] == 1 and _expression(module.get(name)) == _expression(names[name])}


def _expression(value: Any, room: list[int] | None = None) -> str:
    """Plain data as an expression; empty for anything else, and for more than `MOST_ITEMS`, of which `room` counts the rest."""
    room = [MOST_ITEMS + 1] if room is None else room
    room[0] -= 1
    size = value.size if isinstance(value, np.ndarray) else len(value) if isinstance(value, SIZED) else 0
    if size > room[0] or (type(value) is int and value.bit_length() > LONGEST_INTEGER):
        return ""
    if isinstance(value, np.generic) and value.dtype.kind in NUMBERS:
        return _expression(value.item())
    if type(value) is np.ndarray and value.dtype.kind in NUMBERS and size:
        room[0] -= size
        return f"np.array({_expression(value.tolist(), [4 * MOST_ITEMS])}, dtype={value.dtype.str!r})"
    if type(value) in (float, complex):
        return repr(value) if cmath.isfinite(value) else f"{type(value).__name__}('{value}')"
    if type(value) in (list, tuple, dict):
        parts = [_expression(part, room) for part in list(value)]
        if type(value) is dict:
            pairs = zip(parts, [_expression(part, room) for part in value.values()], strict=True)
            parts = [f"{key}: {part}" if key and part else "" for key, part in pairs]
        if "" in parts:
            return ""
        text = ", ".join(parts) + "," * (type(value) is tuple and len(value) == 1)
        return {list: "[{}]", tuple: "({})", dict: "{{{}}}"}[type(value)].format(text)
    return repr(value) if value is None or type(value) in (bool, int, str) else ""


def _runs(node: ast.stmt, name: str) -> bool:
    """Whether a statement uses the class itself, as one that simulates with it does, and is no definition."""
    defines = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))
    return not defines and name in _used(_compiled([node]))


def _compiled(statements: list[ast.stmt]) -> CodeType:
    return compile(ast.Module(statements, []), "", "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT, dont_inherit=True)


def _used(code: CodeType) -> set[str]:
    """Names that a piece of code takes from its file: not those of variables in its functions."""
    inner = [one for one in code.co_consts if isinstance(one, CodeType)]
    return {step.argval for step in dis.get_instructions(code) if step.opname in LOADS}.union(*map(_used, inner))


def _bound(node: ast.stmt) -> set[str]:
    """Names that a statement defines."""
    if _is_future(node):
        return set()
    return {step.argval for step in dis.get_instructions(_compiled([node])) if step.opname == "STORE_NAME"}


def _is_future(node: ast.stmt) -> bool:
    return isinstance(node, ast.ImportFrom) and node.module == FUTURE


def _is_main(node: ast.stmt) -> bool:
    """Whether a statement runs only when the file is run by itself."""
    return isinstance(node, ast.If) and "__name__" in (getattr(part, "id", "") for part in ast.walk(node.test))


def _holds(node: ast.stmt, line: int) -> bool:
    """Whether a statement is the class itself, or encloses it."""
    return isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.lineno <= line <= (node.end_lineno or 0)


def _definition(name: str, value: Any) -> str:
    """A statement that defines a name from another cell or an enclosing function; empty if there is none."""
    if isinstance(value, ModuleType):
        return f"import {value.__name__} as {name}"
    origin, known = getattr(value, "__module__", None), getattr(value, "__qualname__", "")
    if origin in (None, "__main__", "builtins") or getattr(sys.modules.get(origin), known, None) is not value:
        return ""
    if origin == OwnLaw.__module__:
        origin = "flexlab"  # Recordings outlive the modules in which public names stand.
    return f"from {origin} import {known} as {name}"
