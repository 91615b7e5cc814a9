"""What a user's path declares: options with unit and range, and how long it lasts; read, not run."""

import ast
from dataclasses import dataclass
from typing import Any

from flexlab.own_laws.declaration import Gain, check_gain, gain, kind_of
from flexlab.own_laws.reading import DeclaredClass, called

MOST_OPTIONS = 64
SHORTEST, LONGEST = 0.01, 1000.0
"""s that a path may last."""
LASTING = ("duration", "period")
"""Names under which a path says how long it lasts, until it stands or until it repeats."""


class OwnPath:
    """Base of a desired motion written in Python; it is a function of time and of its options alone.

    Class attributes declare it: `option(...)`s, and either `duration` (it ends, and its last pose is held) or `period` (it
    repeats), in s, as a number, an option, or a method.
    `position(self, t)` returns x, y, m, and θ, rad, of the beam's middle at `t` s from the path's start. Within it
    `self.<option>` is the option's present value.

    It is asked for its poses when it is chosen, when an option changes and when its file is saved; a spline of degree five
    through them is what the payload follows, and what recordings keep.
    """

    def position(self, t: float) -> Any:
        """x, y, θ, m, m, rad, at `t` s."""
        raise NotImplementedError("define position(self, t)")


def option(
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
    """Declare an option: its default, unit and allowed range. Three numbers as default: one each for x, y and θ.

    `title`: its name on the screen (otherwise made of the attribute's). `slider`: the part of the range that the slider
    covers (otherwise all of it); `logarithmic`: whether equal ratios are equally far apart on it.
    """
    return gain(default, unit, low=low, high=high, title=title, symbol=symbol, slider=slider, logarithmic=logarithmic)


@dataclass(frozen=True)
class PathDeclaration:
    """All that is known of a path without running it."""

    name: str
    """Of the class."""
    line: int
    """Where it begins in its file."""
    meaning: str
    """First paragraph of its docstring."""
    repeats: bool
    """Whether it says a period."""
    options: tuple[tuple[str, Gain], ...]

    @property
    def kind(self) -> str:
        """Its name in scenarios."""
        return kind_of(self.name)


def read_path_declaration(source: str, file: str) -> PathDeclaration:
    """What the path in `source` declares. Raises `ScenarioError` with file and line where it cannot be read."""
    path = DeclaredClass(source, file, "OwnPath", "trajectory.source")
    options: dict[str, Gain] = {}
    lasting = [name for name in LASTING if path.has_method(name)]
    for name, value in path.attributes():
        is_option = isinstance(value, ast.Call) and called(value.func) == "option"
        if is_option and isinstance(value, ast.Call):
            options[name] = path.made(name, option, value)
            check_gain(path, name, options[name], value.lineno)
        if name in LASTING:
            lasting.append(name)
            if not is_option:
                path.number(value, name, SHORTEST, LONGEST, "s")
    if len(set(lasting)) != 1:
        text = f"{path.node.name} says {' and '.join(dict.fromkeys(lasting)) or 'neither duration nor period'}"
        raise path.problem(path.line, f"{text}: give duration = ... or period = ... in s, one of the two")
    if not path.has_method("position"):
        raise path.problem(path.line, f"{path.node.name} has no method position(self, t), which gives x, y and θ")
    path.few("options", sum(3 if isinstance(one.default, tuple) else 1 for one in options.values()), MOST_OPTIONS)
    return PathDeclaration(path.node.name, path.line, path.meaning, lasting[0] == "period", tuple(options.items()))
