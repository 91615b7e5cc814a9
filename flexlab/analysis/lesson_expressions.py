"""Checks of own lessons: expressions over the metrics and signals of the present run, and over the scenario's fields.

`settling_time < 0.2`, `rms_error.y < 1e-4`, `largest(tracking_error[0:2]) < 1e-3 and t > 2`,
`scenario.payload.bending_stiffness <= 10`. All SI.
They are read by Python's own parser and worked out here: nothing but the names below can be reached.
"""

import ast
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

from flexlab.analysis.metrics import METRICS, run_metrics
from flexlab.analysis.metrics.names import number_names
from flexlab.errors import LabError
from flexlab.plain_text import syntax_tree
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.signals import DERIVED, TABLE

LONGEST = 400
"""Characters of an expression."""

FUNCTIONS: dict[str, Callable[[np.ndarray], float]] = {
    "largest": lambda values: float(np.nanmax(np.abs(values))),
    "rms": lambda values: float(np.sqrt(np.nanmean(np.square(values)))),
    "mean": lambda values: float(np.nanmean(values)),
    "first": lambda values: float(np.ravel(values[0])[0]),
    "last": lambda values: float(np.ravel(values[-1])[0]),
}
"""What makes one number of a signal."""

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
    """An expression that cannot be a check; the text says which part, and what there is instead."""


class Expression:
    """A check: `holds` for a run or not."""

    def __init__(self, text: str):
        """Raises `ExpressionError` for what is no check, whatever the run."""
        self.text = text
        if len(text) > LONGEST:
            raise ExpressionError(f"the check has {len(text)} characters, over {LONGEST}: shorten it.")
        try:
            self._tree = syntax_tree(text.strip(), "eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise ExpressionError(f"the check {text[:60]!r} cannot be read ({error}).") from None
        _check(self._tree)
        if not isinstance(self._tree, (ast.Compare, ast.BoolOp)) and not _is_not(self._tree):
            raise ExpressionError(f"the check {text[:60]!r} is no comparison: write for example settling_time < 0.2.")

    def holds(self, scenario: Scenario, samples: Samples) -> bool:
        """Whether it is true of a run now; what has no value yet (NaN) compares false."""
        return bool(_value(self._tree, _Run(scenario, samples)))


class _Run:
    """What names stand for; metrics are worked out once."""

    def __init__(self, scenario: Scenario, samples: Samples):
        self.scenario, self.samples = scenario, samples
        self._metrics: Any = None

    def number(self, name: str) -> float:
        if name == "t":
            return float(self.samples.time[-1])
        if self._metrics is None:
            self._metrics = run_metrics(self.samples)
        if "." in name:
            return float(self._metrics[name])
        value = getattr(self._metrics, name)
        return float(np.max(value)) if isinstance(value, tuple) else float(value)


def _is_not(node: ast.AST) -> bool:
    return isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)


def _check(node: ast.AST) -> None:
    """Raise for a part that no run could give a value."""
    if isinstance(node, ast.BoolOp):
        parts: list[ast.AST] = list(node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.Not, ast.USub)):
        parts = [node.operand]
    elif isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
        parts = [node.left, node.right]
        for part in parts:
            if isinstance(part, ast.Constant) and isinstance(part.value, str):
                raise ExpressionError(f"{ast.unparse(node)[:60]}: a text can only be compared.")
    elif isinstance(node, ast.Compare) and all(type(op) in _COMPARISONS for op in node.ops):
        parts = [node.left, *node.comparators]
    elif isinstance(node, ast.Call):
        parts = []
        _check_call(node)
    elif isinstance(node, ast.Name):
        parts = []
        if node.id != "t" and node.id not in METRICS:
            hint = f": use {', '.join(FUNCTIONS)} of it" if node.id in TABLE or node.id in DERIVED else ""
            raise ExpressionError(f"{node.id} is no metric{hint}. There are t, {', '.join(METRICS)}.")
    elif isinstance(node, ast.Attribute):
        parts = []
        if not _path(node) and ast.unparse(node) not in number_names():
            raise ExpressionError(f"{ast.unparse(node)[:60]} is no field: write scenario.payload.length, for example.")
    elif isinstance(node, ast.Constant) and (
        isinstance(node.value, str) or (isinstance(node.value, (int, float)) and not isinstance(node.value, bool))
    ):
        parts = []
    else:
        raise ExpressionError(f"{ast.unparse(node)[:60]} cannot stand in a check.")
    for part in parts:
        _check(part)


def _check_call(node: ast.Call) -> None:
    name = node.func.id if isinstance(node.func, ast.Name) else ""
    if name not in FUNCTIONS or len(node.args) != 1 or node.keywords:
        raise ExpressionError(f"{ast.unparse(node)[:60]}: functions are {', '.join(FUNCTIONS)}, each of one signal.")
    signal, _ = _signal(node.args[0])
    if signal not in TABLE and signal not in DERIVED:
        raise ExpressionError(f"{signal[:40]} is no signal: there are {', '.join((*TABLE, *DERIVED))}.")


def _signal(node: ast.AST) -> tuple[str, Any]:
    """Name of a signal and the index of its components; raises for anything else."""
    if isinstance(node, ast.Name):
        return node.id, ...
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Name):
        try:
            index = eval_index(node.slice)
        except ValueError:
            raise ExpressionError(
                f"{ast.unparse(node)[:60]}: components are whole numbers, or ranges of them."
            ) from None
        return node.value.id, index
    raise ExpressionError(f"{ast.unparse(node)[:60]} is no signal.")


def eval_index(node: ast.AST) -> Any:
    """An index of whole numbers, ranges and tuples of both. Raises ValueError for anything else."""
    if isinstance(node, ast.Tuple):
        return tuple(eval_index(part) for part in node.elts)
    if isinstance(node, ast.Slice):
        return slice(*(None if part is None else eval_index(part) for part in (node.lower, node.upper, node.step)))
    value = ast.literal_eval(node)
    if isinstance(value, bool) or not isinstance(value, int):
        raise ValueError
    return value


def _path(node: ast.AST) -> str:
    """The dotted path of a field of the scenario; empty for anything else."""
    names: list[str] = []
    while isinstance(node, ast.Attribute):
        names.insert(0, node.attr)
        node = node.value
    return ".".join(names) if isinstance(node, ast.Name) and node.id == "scenario" and names else ""


def _number(node: ast.AST, run: _Run) -> float:
    """What is computed with: one number, as a text or a list times a number could be of any length."""
    value = _value(node, run)
    if not isinstance(value, (int, float)):
        raise ExpressionError(f"{ast.unparse(node)[:60]} is not a number here.")
    return float(value)


def _value(node: ast.AST, run: _Run) -> Any:
    if isinstance(node, ast.Constant):
        return node.value
    if isinstance(node, ast.Name):
        return run.number(node.id)
    if isinstance(node, ast.Attribute):
        if not _path(node):
            return run.number(ast.unparse(node))
        value = run.scenario.get(_path(node))
        return value[0] if isinstance(value, tuple) and len(set(value)) == 1 else value
    if isinstance(node, ast.BoolOp):
        combine = all if isinstance(node.op, ast.And) else any
        return combine(_value(part, run) for part in node.values)
    if isinstance(node, ast.UnaryOp):
        return not _value(node.operand, run) if isinstance(node.op, ast.Not) else -_number(node.operand, run)
    if isinstance(node, ast.BinOp):
        return _ARITHMETIC[type(node.op)](_number(node.left, run), _number(node.right, run))
    if isinstance(node, ast.Compare):
        values = [_value(part, run) for part in (node.left, *node.comparators)]
        pairs = zip(node.ops, values, values[1:], strict=False)
        return all(_COMPARISONS[type(op)](one, other) for op, one, other in pairs)
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    signal, index = _signal(node.args[0])
    values = np.asarray(run.samples[signal])
    if index is not ...:
        values = values[(slice(None), *(index if isinstance(index, tuple) else (index,)))]
    return FUNCTIONS[node.func.id](values)
