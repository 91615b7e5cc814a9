"""What a user's control law declares: gains with unit and range, memory, signals, period; read, not run.

So a recording, a shared scenario or a menu can show a law whose code nobody has allowed to run.
"""

import ast
import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flexlab.own_laws.reading import DeclaredClass, called, is_finite

MOST_GAINS, MOST_SIGNALS, MOST_MEMORY = 64, 16, 256
"""Numbers that go with each call, at most."""
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
        """Its name in scenarios."""
        return kind_of(self.name)


def kind_of(name: str) -> str:
    """The name in scenarios of a class: SoftPD becomes soft-pd, PIDControl pid-control."""
    return re.sub(WORDS, "-", name).replace("_", "-").lower()


def digest(source: str) -> str:
    """What tells one source from another."""
    return hashlib.sha256(source.encode()).hexdigest()[:16]


def read_declaration(source: str, file: str) -> Declaration:
    """What the law in `source` declares. Raises `ScenarioError` with file and line where it cannot be read."""
    law = DeclaredClass(source, file, "OwnLaw", "controller.source")
    found: dict[type, list[tuple[str, Any]]] = {Gain: [], Memory: [], OwnSignal: []}
    period, on_save = DEFAULT_PERIOD, OwnLaw.on_save
    for name, value in law.attributes():
        maker = _MAKERS.get(called(value.func)) if isinstance(value, ast.Call) else None
        if maker is not None and isinstance(value, ast.Call):
            made = law.made(name, maker, value)
            _check(law, name, made, value.lineno)
            found[type(made)].append((name, made))
        elif name == "period":
            period = law.number(value, "period", SHORTEST_PERIOD, LONGEST_PERIOD, "s")
        elif name == "on_save":
            on_save = law.value(value)
            if on_save not in ON_SAVE:
                raise law.problem(value.lineno, f"on_save = {on_save!r} is none of " + ", ".join(map(repr, ON_SAVE)))
    if not law.has_method("act"):
        raise law.problem(law.line, f"{law.node.name} has no method act(self, at), which computes the inputs")
    gains, memories = dict(found[Gain]), dict(found[Memory])
    law.few("gains", sum(3 if isinstance(one.default, tuple) else 1 for one in gains.values()), MOST_GAINS)
    law.few("numbers of memory", sum(one.size for one in memories.values()), MOST_MEMORY)
    law.few("signals", len(found[OwnSignal]), MOST_SIGNALS)
    return Declaration(
        law.node.name,
        law.line,
        law.meaning,
        period,
        on_save == ON_SAVE[0],
        tuple(gains.items()),
        tuple(memories.items()),
        tuple(found[OwnSignal]),
    )


_MAKERS: dict[str, Callable[..., Any]] = {"gain": gain, "memory": memory, "readout": readout}


def _check(law: DeclaredClass, name: str, made: Any, line: int) -> None:
    if isinstance(made, Memory):
        if not isinstance(made.size, int) or not 1 <= made.size <= MOST_MEMORY or not is_finite(made.start):
            text = f"{name} = memory({made.size!r}, {made.start!r}) needs a whole number from 1 to {MOST_MEMORY}"
            raise law.problem(line, f"{text} and a finite start")
    elif isinstance(made, OwnSignal):
        if not all(isinstance(text, str) for text in (made.unit, made.title, made.symbol)):
            raise law.problem(line, f"{name}: unit, title and symbol of a signal are texts")
    else:
        check_gain(law, name, made, line)


def check_gain(declared: DeclaredClass, name: str, gain: Gain, line: int) -> None:
    """Raises `ScenarioError` for a range that is none or a default outside it."""
    if not is_finite(gain.low) or not is_finite(gain.high) or not gain.low < gain.high:
        raise declared.problem(line, f"{name}: low = {gain.low!r} and high = {gain.high!r} are no range")
    numbers = gain.default if isinstance(gain.default, tuple) else (gain.default,)
    if len(numbers) not in (1, 3) or not all(is_finite(one) and gain.low <= one <= gain.high for one in numbers):
        text = f"{name}: the default {gain.default!r} is outside {gain.low:g} to {gain.high:g} {gain.unit}"
        raise declared.problem(line, f"{text}, or not one or three numbers")
