"""In which fields two scenarios differ: the one walk through both, and the three forms in which it is asked for."""

from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

TEXTS = ("title", "watch")
"""Fields that say something of a scenario and change nothing in it."""

ENGINE = "trajectory.transition"
"""A field that nobody sets: what a change of the path in motion leaves over for a moment."""

FOLLOW = ("trajectory.table", "trajectory.table_of")
"""Fields that follow from others: from the text of a person's own path and its options."""

Difference = tuple[str, Any, Any]
"""(dotted path, value in one, value in the other)."""


def part_differences(one: BaseModel, other: BaseModel, path: str = "") -> Iterator[Difference]:
    """Every field that differs; parts of different kinds, or a part and none, stand as one difference."""
    for name in type(one).model_fields:
        inner, old, new = f"{path}.{name}" if path else name, getattr(one, name), getattr(other, name)
        if isinstance(old, BaseModel) and type(old) is type(new):
            yield from part_differences(old, new, inner)
        elif old != new and inner != ENGINE:
            yield inner, old, new


def differences(one: BaseModel, other: BaseModel) -> list[Difference]:
    """Every single field that differs, those of differing kinds too (None where one has no such field); no texts."""
    found = []
    for path, old, new in part_differences(one, other):
        first, second = dict(_leaves(_plain(old), path)), dict(_leaves(_plain(new), path))
        both = ((name, first.get(name), second.get(name)) for name in {**first, **second})
        found += [item for item in both if not item[0].startswith((*TEXTS, ENGINE, *FOLLOW)) and item[1] != item[2]]
    return found


def changes_towards(present: BaseModel, wanted: BaseModel) -> dict[str, Any]:
    """Changes by path that make `present` into `wanted`, as `Scenario.replace` takes them; a new kind before its fields."""
    changes: dict[str, Any] = {}
    for path, old, new in part_differences(present, wanted):
        if isinstance(old, BaseModel) and isinstance(new, BaseModel):
            fields = new.model_dump()
            changes[f"{path}.kind"] = fields.pop("kind")
            changes |= {f"{path}.{name}": value for name, value in fields.items()}
            changes.pop(ENGINE, None)
        else:
            changes[path] = _plain(new)
    return changes


def _plain(value: Any) -> Any:
    return value.model_dump() if isinstance(value, BaseModel) else value


def _leaves(data: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(data, dict):
        for name, value in data.items():
            yield from _leaves(value, f"{path}.{name}")
    else:
        yield path, data
