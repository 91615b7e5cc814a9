"""The description of a run's signal, in one place: name, symbol, unit, shape, meaning, equation, age.

`flexlab.sim.signals` is the table of all runs' signals; a control law adds those of its own memory. Row layout, arrays,
documentation, export columns and recordings follow from these rows.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import prod
from typing import Any, NamedTuple, dataclass_transform

import numpy as np


class Axis(NamedTuple):
    """One axis of a signal's array beside time."""

    size: str
    """Its length in words: a number, "arms" or "n_q"."""
    labels: tuple[str, ...]
    """Names of the entries in column names; for a beam's coordinates, the two kinds that alternate."""


AXIS = Axis("3", ("x", "y", "theta"))
"""The payload's three coordinates."""
JOINT = Axis("3", ("1", "2", "3"))
"""An arm's joints, base first."""
ARM = Axis("arms", ("left", "right"))
"""The arms of the scenario, one or two."""
COORDINATE = Axis("n_q", ("deflection", "slope"))
"""The beam's free nodal coordinates, left to right."""


def numbered(count: int) -> Axis:
    """An axis of `count` entries named by numbers."""
    return Axis(str(count), tuple(map(str, range(count))))


@dataclass(frozen=True)
class Signal:
    """One row of a table of signals."""

    name: str
    """Attribute of `Samples`, and name in recordings and tables."""
    symbol: str
    """As in `flexlab.notation`, if it is there."""
    units: tuple[str, ...]
    """SI: one for all entries, or one for each label of the last axis."""
    meaning: str
    """Meaning in words."""
    axes: tuple[Axis, ...] = ()
    """Axes besides time."""
    equation: str = ""
    """Its equation, or where the paper introduces it."""
    since: int = 1
    """Format of recordings since which the name has this meaning."""
    computed_since: int = 1
    """Format of recordings since which it is computed as today; earlier ones differ in the last digits."""
    derived: bool = False
    """Whether it follows from other signals, and so is neither simulated nor recorded."""
    plotted: bool = False
    """Whether it has a plot of its own, as a law's signals have; `flexlab.views` plots some signals together."""

    @property
    def fixed_size(self) -> int:
        """Numbers per sample and arm; the axis of beam coordinates does not count."""
        return prod(len(axis.labels) for axis in self.axes if axis not in (ARM, COORDINATE))

    def shape(self, arm_count: int, coordinate_count: int) -> tuple[int, ...]:
        """Shape of one sample."""
        lengths = {ARM: arm_count, COORDINATE: coordinate_count}
        return tuple(lengths.get(axis, len(axis.labels)) for axis in self.axes)

    @property
    def unit_text(self) -> str:
        """The units as text: "m, m, rad"."""
        return ", ".join(self.units)

    @property
    def shape_text(self) -> str:
        """The array's shape as text: "(N, arms, 3)"."""
        sizes = ["N", *(axis.size for axis in self.axes)]
        return f"({', '.join(sizes)}{',' if len(sizes) == 1 else ''})"

    @property
    def text(self) -> str:
        """Symbol, meaning, equation, units and shape in one line."""
        source = f" [{self.equation}]" if self.equation else ""
        unit = self.unit_text if self.units != ("1",) else "no unit"
        return f"{self.symbol}: {self.meaning}{source}, {unit}, {self.shape_text}"


def signal_lines(signals: Iterable[Signal]) -> str:
    """A docstring's list of signals, a line each."""
    return "\n".join(f"    {signal.name} -- {signal.text}" for signal in signals)


def row(symbol: str, unit: str | tuple[str, ...], meaning: str, *axes: Axis, equation: str = "", **more: Any) -> Any:
    """A row of a `table`: a field that carries a `Signal`, whose name is the field's."""
    units = (unit,) if isinstance(unit, str) else unit
    return field(metadata={"signal": lambda name: Signal(name, symbol, units, meaning, axes, equation, **more)})


class derived:
    """A row of a `table` that is computed from others: a property of shape (N,) unless axes are given."""

    def __init__(self, symbol: str, unit: str | tuple[str, ...], *axes: Axis, equation: str = "", **more: Any):
        self._about = symbol, (unit,) if isinstance(unit, str) else unit, axes, equation, more

    def __call__(self, formula: Callable[[Any], np.ndarray]) -> "derived":
        """Take the formula, whose docstring is the signal's meaning."""
        symbol, units, axes, equation, more = self._about
        meaning = " ".join((formula.__doc__ or "").split()).rstrip(".")
        meaning = meaning[:1].lower() + meaning[1:]
        self.signal = Signal(formula.__name__, symbol, units, meaning, axes, equation, derived=True, **more)
        self._formula, self.__doc__ = formula, self.signal.text
        return self

    def __get__(self, samples: Any, owner: type | None = None) -> np.ndarray:
        return self if samples is None else self._formula(samples)  # type: ignore[return-value]  # The class gives the row itself.


@dataclass_transform(field_specifiers=(row,), kw_only_default=True, frozen_default=True)
def table(cls: type) -> type:
    """Make a class of rows a table."""
    return dataclass(frozen=True, init=False, eq=False, repr=False)(cls)
