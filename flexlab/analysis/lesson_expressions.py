"""Expressions of lessons over metrics, signals and measures of a run, and over the scenario's fields.

`settling_time < 0.2`, `rms_error.y < 1e-4`, `largest(tracking_error[0:2]) < 1e-3 and t > 2`, `largest(vibration, t - 1, t)`,
`scenario.payload.bending_stiffness <= 10`, `scenario.payload == usual.payload`, `ring_frequency(0, 0.6)`. All SI.
Python's parser reads them, and this module evaluates them with the names below only.
"""

import ast
import operator
from collections.abc import Callable, Collection
from itertools import pairwise
from typing import Any

import numpy as np

from flexlab.analysis.lesson_measures import OF_A_PART, VALUES, Look
from flexlab.analysis.metrics import METRICS
from flexlab.analysis.metrics.metric import number_names
from flexlab.errors import LabError
from flexlab.scenario import parse_scenario
from flexlab.sim.signals import DERIVED, TABLE
from flexlab.text import number_text, syntax_tree

LONGEST = 400
"""Largest length of an expression, characters."""
ROOTS = ("scenario", "usual")
"""Owners of fields: the run's scenario, and the default scenario, that of the preset paper."""
FUNCTIONS: dict[str, Callable[[np.ndarray], float]] = {
    "largest": lambda values: float(np.nanmax(np.abs(values))),
    "rms": lambda values: float(np.sqrt(np.nanmean(np.square(values)))),
    "mean": lambda values: float(np.nanmean(values)),
    "first": lambda values: float(np.ravel(values[0])[0]),
    "last": lambda values: float(np.ravel(values[-1])[0]),
    "largest_norm": lambda values: float(np.nanmax(_norms(values))),
    "rms_norm": lambda values: float(np.sqrt(np.nanmean(np.square(_norms(values))))),
}
"""Functions that reduce a signal to one number, over all samples or between two instants. Norms are taken per sample."""
TRUTHS = ("starts", "changed", "touched")
"""Measures that are true or false."""
EXTREMES: dict[str, Callable[[Any], float]] = {"least": min, "greatest": max}
"""Functions that reduce a field of one or three numbers to one number."""


def _norms(values: np.ndarray) -> np.ndarray:
    return np.linalg.norm(values.reshape(len(values), -1), axis=1)


_ARITHMETIC: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_COMPARISONS: dict[type, Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


class ExpressionError(LabError):
    """An invalid expression; the text names the wrong part and the alternatives."""


Value = Callable[[Look], Any]
"""Returns the value of a part of an expression in the present state of a run."""


def expression(text: str, known: Collection[str] = (), truth: bool = False) -> Value:
    """Compile an expression. Raises `ExpressionError` for one that has no value in any run.

    `known`: names that a lesson defines. `truth`: whether the expression must be true or false; a comparison with NaN, a
    missing value, is false.
    """
    if len(text) > LONGEST:
        raise ExpressionError(f"the check has {len(text)} characters, over {LONGEST}: shorten it.")
    try:
        tree = syntax_tree(text.strip(), "eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        reason = error.msg if isinstance(error, SyntaxError) else error  # Without "<unknown>, line 1".
        raise ExpressionError(f"the check {text[:60]!r} cannot be read ({reason}).") from None
    value = _compiled(tree, known)
    is_truth = isinstance(tree, (ast.Compare, ast.BoolOp)) or isinstance(getattr(tree, "op", None), ast.Not)
    if truth and not is_truth and not (isinstance(tree, ast.Name) and tree.id in (*known, *TRUTHS)):
        raise ExpressionError(f"the check {text[:60]!r} is not a comparison: write for example settling_time < 0.2.")
    return value


def _compiled(node: ast.AST, known: Collection[str]) -> Value:
    """Compile a part of an expression. Raises `ExpressionError` for one that has no value in any run."""
    if isinstance(node, ast.Constant) and type(node.value) in (str, int, float):
        return lambda run: node.value
    if isinstance(node, ast.Name):
        if node.id not in (*known, *VALUES, *METRICS):
            hint = f": use {', '.join(FUNCTIONS)} of it" if node.id in TABLE or node.id in DERIVED else ""
            raise ExpressionError(f"{node.id} is not a metric{hint}. There are {', '.join((*METRICS, *VALUES))}.")
        return lambda run: run.value(node.id)
    if isinstance(node, ast.Attribute):
        return _attribute(node)
    if isinstance(node, ast.BoolOp):
        parts = [_compiled(part, known) for part in node.values]
        combine = all if isinstance(node.op, ast.And) else any
        return lambda run: combine(part(run) for part in parts)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        negated = _compiled(node.operand, known)
        return lambda run: not negated(run)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        number = _number(node.operand, known)
        return lambda run: -number(run)
    if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        if any(isinstance(part, ast.Constant) and isinstance(part.value, str) for part in (node.left, node.right)):
            raise ExpressionError(f"{ast.unparse(node)[:60]}: a text can only be compared.")
        work, left, right = _ARITHMETIC[type(node.op)], _number(node.left, known), _number(node.right, known)
        return lambda run: work(left(run), right(run))
    if isinstance(node, ast.Compare) and all(type(op) in _COMPARISONS for op in node.ops):
        tests = [_COMPARISONS[type(op)] for op in node.ops]
        sides = [_compiled(part, known) for part in (node.left, *node.comparators)]
        return lambda run: all(
            test(one, other) for test, (one, other) in zip(tests, pairwise(side(run) for side in sides), strict=True)
        )
    if isinstance(node, ast.Call):
        return _call(node, known)
    raise ExpressionError(f"{ast.unparse(node)[:60]} cannot stand in a check.")


def _number(node: ast.AST, known: Collection[str]) -> Callable[[Look], float]:
    """Compile an operand, which must be one number: a text or list times a number could have any length."""
    part = _compiled(node, known)

    def number(run: Look) -> float:
        value = part(run)
        if not isinstance(value, (int, float)):
            raise ExpressionError(f"{ast.unparse(node)[:60]} is not a number here")
        return float(value)

    return number


def _attribute(node: ast.Attribute) -> Value:
    """A field, or a number of a metric. Raises `ExpressionError` for anything else."""
    path, name = _path(node), ast.unparse(node)
    if path:
        return lambda run: value[0] if isinstance(value := _field(path, run), tuple) and len(set(value)) == 1 else value
    if name not in number_names():
        raise ExpressionError(f"{name[:60]} is not a field: write scenario.payload.length, for example.")
    return lambda run: run.value(name)


def _call(node: ast.Call, known: Collection[str]) -> Value:
    """A function's value. Raises `ExpressionError` for an unknown function or wrong arguments."""
    name, given = node.func.id if isinstance(node.func, ast.Name) and not node.keywords else "", list(node.args)
    if name in EXTREMES and len(given) == 1 and (path := _path(given[0])):
        return lambda run: float(EXTREMES[name](value if isinstance(value := _field(path, run), tuple) else (value,)))
    signal, index = "", ...
    if name in FUNCTIONS and len(given) in (1, 3):
        signal, index = _signal(given.pop(0))
        if signal not in TABLE and signal not in DERIVED:
            raise ExpressionError(f"{signal[:40]} is not a signal: there are {', '.join((*TABLE, *DERIVED))}.")
    elif name not in OF_A_PART or len(given) != 2:
        raise ExpressionError(
            f"{ast.unparse(node)[:60]}: functions are {', '.join(FUNCTIONS)}, each of one signal (and two instants), "
            f"{', '.join(EXTREMES)}, of a field, and {', '.join(OF_A_PART)}, of two instants."
        )
    window = [_number(part, known) for part in given]
    fewest = 2 if name in OF_A_PART else 1

    def measured(run: Look) -> float:
        begin, end = (instant(run) for instant in window) if window else (-np.inf, np.inf)
        samples = run.part(begin, end)
        if len(samples) < fewest:  # Of none, some measures would be 0, which is no result.
            times = f"t = {number_text(begin)} s to {number_text(end)} s"
            raise ExpressionError(f"{ast.unparse(node)[:60]}: there are too few samples from {times}")
        if name in OF_A_PART:
            return OF_A_PART[name](run, samples)
        return FUNCTIONS[name](np.asarray(samples[signal])[index])

    return measured


def _signal(node: ast.AST) -> tuple[str, Any]:
    """Name of a signal, and the index of its samples' components. Raises `ExpressionError` for anything else."""
    if isinstance(node, ast.Name):
        return node.id, ...
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
        try:
            index = eval_index(node.slice)
        except ValueError:
            raise ExpressionError(
                f"{ast.unparse(node)[:60]}: components are whole numbers, or ranges of them."
            ) from None
        return node.value.id, (slice(None), *(index if isinstance(index, tuple) else (index,)))
    raise ExpressionError(f"{ast.unparse(node)[:60]} is not a signal.")


def eval_index(node: ast.AST) -> Any:
    """An index made of whole numbers, ranges and tuples of both. Raises ValueError for anything else."""
    if isinstance(node, ast.Tuple):
        if any(isinstance(part, ast.Tuple) for part in node.elts):  # NumPy would make arrays of any size from them.
            raise ValueError
        return tuple(eval_index(part) for part in node.elts)
    if isinstance(node, ast.Slice):
        return slice(*(None if part is None else eval_index(part) for part in (node.lower, node.upper, node.step)))
    value = ast.literal_eval(node)
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError
    return value


def _path(node: ast.AST) -> str:
    """The dotted path of a field, beginning with `scenario` or `usual`; empty for anything else."""
    names: list[str] = []
    while isinstance(node, ast.Attribute):
        names.insert(0, node.attr)
        node = node.value
    return ".".join([node.id, *names]) if isinstance(node, ast.Name) and node.id in ROOTS and names else ""


def _field(path: str, run: Look) -> Any:
    """A field's value; NaN, which compares false, if it is not set."""
    root, _, name = path.partition(".")
    value = (run.scenario if root == "scenario" else parse_scenario({})).get(name)
    return np.nan if value is None else value
