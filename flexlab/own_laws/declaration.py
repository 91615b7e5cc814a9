"""What a user's control law declares: gains with unit and range, memory, signals, period; read, not run.

So a recording, a shared scenario or a menu can show a law whose code nobody has allowed to run.
"""

import ast
import hashlib
import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flexlab.errors import ScenarioError

MOST_GAINS, MOST_SIGNALS, MOST_MEMORY = 64, 16, 256
"""Numbers that go with each call, at most."""
LONGEST_SOURCE = 200_000
"""Characters of a law's text."""
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-5, 0.1
"""s, as for every sampled controller."""
DEFAULT_PERIOD = 1e-3
"""s."""
ON_SAVE = ("go on", "restart")
WORDS = r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])"
"""Where a class's name has its words' bounds."""


class OwnLaw:
    """Base of a control law written in Python; it runs at control instants, `period` s apart.

    Class attributes declare it: `gain(...)`, `memory(...)`, `readout(...)`, `period` and `on_save`, with numbers that stand
    in the file.
    `act(self, at)` returns the inputs of the arms, (arms, 3): forces in N and torques in N·m at the grips, or what
    `at.from_torques(joint_torques)` makes of joint torques. `at`: a `Measurement`. Within it `self.<gain>` is the gain's
    present value, `self.<memory>` an array to read and change, `self.<readout>` a number to set.

    `act` must follow from gains, measurement and memory alone: the engine may ask twice for one instant, to check its own
    accuracy, and a replay asks again. What it needs to remember belongs into a memory, which recordings keep.
    """

    period: float = DEFAULT_PERIOD
    on_save: str = "go on"
    """What a lab does when the file is saved: "go on" with the memory as it is, or "restart" the run."""

    def act(self, at: Any) -> Any:
        """The inputs of the arms, (arms, 3), N, N, N·m."""
        raise NotImplementedError("define act(self, at)")


@dataclass(frozen=True)
class Gain:
    """A gain: one number, or three for x, y and θ, which may also be given as one."""

    default: float | tuple[float, float, float]
    unit: str
    low: float
    high: float
    title: str = ""
    symbol: str = ""
    slider: tuple[float, float] | None = None
    logarithmic: bool = False


@dataclass(frozen=True)
class Memory:
    """Numbers that the law keeps from one instant to the next."""

    size: int
    start: float = 0.0


@dataclass(frozen=True)
class OwnSignal:
    """A number that the law shows."""

    unit: str
    title: str = ""
    symbol: str = ""


def gain(
    default: float | tuple[float, float, float],
    unit: str,
    *,
    low: float,
    high: float,
    title: str = "",
    symbol: str = "",
    slider: tuple[float, float] | None = None,
    logarithmic: bool = False,
) -> Any:
    """Declare a gain: its default, unit and allowed range. Three numbers as default: one each for x, y and θ.

    `title`: its name on the screen (otherwise made of the attribute's). `slider`: the part of the range that the slider
    covers (otherwise all of it); `logarithmic`: whether equal ratios are equally far apart on it.
    """
    return Gain(default, unit, low, high, title, symbol, slider, logarithmic)


def memory(size: int, start: float = 0.0) -> Any:
    """Declare `size` numbers that the law keeps from one instant to the next, all `start` at first."""
    return Memory(size, start)


def readout(unit: str, title: str = "", symbol: str = "") -> Any:
    """Declare a number that the law sets at each instant, to be plotted and recorded."""
    return OwnSignal(unit, title, symbol)


@dataclass(frozen=True)
class Declaration:
    """All that is known of a law without running it."""

    name: str
    """Of the class."""
    line: int
    """Where it begins in its file."""
    meaning: str
    """First paragraph of its docstring."""
    period: float
    """s between control instants, unless the scenario says otherwise."""
    goes_on: bool
    """Whether a run goes on, with the memory as it is, when the file is saved anew."""
    gains: tuple[tuple[str, Gain], ...]
    memory: tuple[tuple[str, Memory], ...]
    signals: tuple[tuple[str, OwnSignal], ...]

    @property
    def kind(self) -> str:
        """Its name in scenarios: SoftPD becomes soft-pd, PIDControl pid-control."""
        return re.sub(WORDS, "-", self.name).replace("_", "-").lower()


def digest(source: str) -> str:
    """What tells one source from another."""
    return hashlib.sha256(source.encode()).hexdigest()[:16]


def read_declaration(source: str, file: str) -> Declaration:
    """What the law in `source` declares. Raises `ScenarioError` with file and line where it cannot be read."""
    if len(source) > LONGEST_SOURCE:
        raise _problem(file, 1, f"has {len(source)} characters: keep a control law under {LONGEST_SOURCE}")
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None) or 1
        raise _problem(file, line, f"is no Python text ({getattr(error, 'msg', None) or error})") from None
    laws = [node for node in tree.body if isinstance(node, ast.ClassDef) and "OwnLaw" in map(_called, node.bases)]
    if len(laws) != 1:
        found = "no class" if not laws else f"{len(laws)} classes"
        line = laws[1].lineno if laws else 1
        raise _problem(file, line, f"has {found} that inherit from OwnLaw: write one class Name(OwnLaw): in a file")
    return _Reader(file, tree).declaration(laws[0])


def _problem(file: str, line: int, text: str) -> ScenarioError:
    return ScenarioError([("controller.source", f"{file}, line {line}: {text}.")])


def _called(node: ast.AST) -> str:
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
_DECLARED: dict[str, type] = {"gain": Gain, "memory": Memory, "readout": OwnSignal}


class _Reader:
    """Reads the class attributes of one file; knows the numbers that stand above the class."""

    def __init__(self, file: str, tree: ast.Module):
        self._file = file
        self._known: dict[str, Any] = {}
        for node in tree.body:
            if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
                try:
                    self._known[node.targets[0].id] = self._value(node.value)
                except ScenarioError:
                    continue

    def declaration(self, law: ast.ClassDef) -> Declaration:
        found: dict[type, list[tuple[str, Any]]] = {Gain: [], Memory: [], OwnSignal: []}
        period, on_save = DEFAULT_PERIOD, OwnLaw.on_save
        for name, value in _attributes(law):
            kind = _DECLARED.get(_called(value.func)) if isinstance(value, ast.Call) else None
            if kind is not None and isinstance(value, ast.Call):
                found[kind].append((name, self._declared(name, kind, value)))
            elif name == "period":
                period = self._number(value, "period", SHORTEST_PERIOD, LONGEST_PERIOD, "s")
            elif name == "on_save":
                on_save = self._value(value)
                if on_save not in ON_SAVE:
                    text = f"on_save = {on_save!r} is none of " + ", ".join(map(repr, ON_SAVE))
                    raise _problem(self._file, value.lineno, text)
        if not any(isinstance(node, ast.FunctionDef) and node.name == "act" for node in law.body):
            raise _problem(self._file, law.lineno, f"{law.name} has no method act(self, at), which computes the inputs")
        gains, memories = dict(found[Gain]), dict(found[Memory])
        self._few(law, "gains", sum(3 if isinstance(one.default, tuple) else 1 for one in gains.values()), MOST_GAINS)
        self._few(law, "numbers of memory", sum(one.size for one in memories.values()), MOST_MEMORY)
        self._few(law, "signals", len(found[OwnSignal]), MOST_SIGNALS)
        meaning = " ".join((ast.get_docstring(law) or law.name).split("\n\n")[0].split())
        return Declaration(
            law.name,
            law.lineno,
            meaning,
            period,
            on_save == ON_SAVE[0],
            tuple(gains.items()),
            tuple(memories.items()),
            tuple(found[OwnSignal]),
        )

    def _few(self, law: ast.ClassDef, what: str, count: int, most: int) -> None:
        if count > most:
            raise _problem(self._file, law.lineno, f"{law.name} declares {count} {what}: {most} are the most")

    def _declared(self, name: str, kind: type, call: ast.Call) -> Any:
        try:
            given = [self._value(item) for item in call.args]
            named = {item.arg or "**": self._value(item.value) for item in call.keywords}
            maker: Callable[..., Any] = {Gain: gain, Memory: memory, OwnSignal: readout}[kind]
            made = maker(*given, **named)
        except TypeError as error:
            text = str(error).replace("()", "(...)")
            raise _problem(self._file, call.lineno, f"{name}: {text}") from None
        return self._checked(name, made, call.lineno)

    def _checked(self, name: str, made: Any, line: int) -> Any:
        if isinstance(made, Memory):
            if not isinstance(made.size, int) or not 1 <= made.size <= MOST_MEMORY or not _finite(made.start):
                text = f"{name} = memory({made.size!r}, {made.start!r}) needs a whole number from 1 to {MOST_MEMORY}"
                raise _problem(self._file, line, f"{text} and a finite start")
        elif isinstance(made, OwnSignal):
            if not all(isinstance(text, str) for text in (made.unit, made.title, made.symbol)):
                raise _problem(self._file, line, f"{name}: unit, title and symbol of a signal are texts")
        elif not _finite(made.low) or not _finite(made.high) or not made.low < made.high:
            raise _problem(self._file, line, f"{name}: low = {made.low!r} and high = {made.high!r} are no range")
        else:
            numbers = made.default if isinstance(made.default, tuple) else (made.default,)
            if len(numbers) not in (1, 3) or not all(_finite(one) and made.low <= one <= made.high for one in numbers):
                text = f"{name}: the default {made.default!r} is outside {made.low:g} to {made.high:g} {made.unit}"
                raise _problem(self._file, line, f"{text}, or not one or three numbers")
        return made

    def _number(self, node: ast.expr, name: str, low: float, high: float, unit: str) -> float:
        value = self._value(node)
        if not _finite(value) or not low <= value <= high:
            raise _problem(
                self._file, node.lineno, f"{name} = {value!r} is outside {low:g} to {high:g} {unit}: choose within it"
            )
        return float(value)

    def _value(self, node: ast.expr) -> Any:
        """A number, text, or list of them that stands in the file, or that names and + - * / make of such."""
        if isinstance(node, ast.Constant):
            return node.value
        if isinstance(node, (ast.Tuple, ast.List)):
            return tuple(self._value(item) for item in node.elts)
        if isinstance(node, ast.Name) and node.id in self._known:
            return self._known[node.id]
        try:
            if isinstance(node, ast.UnaryOp) and type(node.op) in _ARITHMETIC:
                return _ARITHMETIC[type(node.op)](self._value(node.operand))
            if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
                first, second = self._value(node.left), self._value(node.right)
                if _finite(first) and _finite(second):
                    return _ARITHMETIC[type(node.op)](first, second)
        except (TypeError, ZeroDivisionError, OverflowError):
            pass
        text = ast.unparse(node)
        raise _problem(
            self._file,
            node.lineno,
            f"{text[:60]} is not a number that stands in the file: declarations are read without running the file",
        )


def _attributes(law: ast.ClassDef) -> list[tuple[str, ast.expr]]:
    """(name, value) of a class's plain attributes."""
    found = []
    for node in law.body:
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            found.append((node.targets[0].id, node.value))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None:
            found.append((node.target.id, node.value))
    return found


def _finite(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300
