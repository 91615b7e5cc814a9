"""Whether a variable of a functional mock-up unit is in a unit of measure that flexlab has, whatever the tool calls it."""

import re
from collections.abc import Iterable
from typing import Any

_BASES = {
    "1": {},
    "m": {"m": 1},
    "rad": {"rad": 1},
    "s": {"s": 1},
    "kg": {"kg": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
}
_FMI_BASES = ("kg", "m", "s", "A", "K", "mol", "cd")
"""Besides rad, which is 1: tools leave it out as they like."""
_SPELT = (("**", "^"), ("^2", "²"), ("2", "²"), ("*", "·"), (".", "·"), (" ", "·"), ("(", ""), (")", ""), ("Nm", "N·m"))


def problem_with_unit(variable: Any, definitions: Iterable[Any], wanted: str) -> str:
    """The unit of measure in which a variable is, where that is not `wanted`; empty: it is, or nothing is said of it."""
    name = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    if not name:
        return ""
    base = next((each.baseUnit for each in definitions if each.name == name), None)
    if base is None:
        return "" if _spelt(name) == wanted else name
    found = {each: getattr(base, each) for each in _FMI_BASES if getattr(base, each)}
    same = found == exponents(wanted) and base.factor == 1 and base.offset == 0
    return "" if same else name


def exponents(unit: str) -> dict[str, int]:
    """Exponents of the base units of one of flexlab's units, as kg·m²/s, without rad."""
    total: dict[str, int] = {}
    for sign, name, power in re.findall(r"([·/]?)([^·/²]+)(²?)", unit):
        for base, exponent in _BASES[name].items():
            total[base] = total.get(base, 0) + exponent * (2 if power else 1) * (-1 if sign == "/" else 1)
    return {base: exponent for base, exponent in total.items() if exponent and base != "rad"}


def _spelt(name: str) -> str:
    for other, ours in _SPELT:
        name = name.replace(other, ours)
    return name
