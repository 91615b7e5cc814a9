"""A scenario's fields in the words of screen, pages and tables: titles, words of menus, and where two scenarios differ."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, cast, get_args, get_origin

from pydantic import BaseModel

from flexlab.files import short_hash
from flexlab.quantities import Part, Quantity, describe, parts_of
from flexlab.scenario.scenario import SAID, Scenario
from flexlab.text import MISSING, number_text

TITLES = {
    "controller.kind": "Control law",
    "trajectory.kind": "Path",
    "trajectory.shaper": "Input shaper",
    "controller.slow.kind": "Slow part",
    "controller.observer.kind": "Observer",
    "payload.damping.kind": "Damping kind",
    "payload.boundary": "Boundary",
    "payload.axial_load": "Force along the beam",
    "controller.model.axial_load": "Believed force along the beam",
    "simulation.integrator": "Integrator",
    "left_arm.elbow": "Elbow side, left",
    "right_arm.elbow": "Elbow side, right",
    "grips.model": "How the grips hold the beam",
    "grips.measured_at": "Where the controller measures the pose",
}
"""Path → title of the field."""
WORDS = {
    "zv": "ZV shaper",
    "zvd": "ZVD shaper",
    "ei-shaper": "EI shaper",
    "lqr": "Linear-quadratic regulator",
    "pd": "PD",
    "joint-pd": "PD of the joints",
    "rk4": "Runge-Kutta, 4th order",
    "etdrk4": "Exponential, 4th order",
    "kalman": "Kalman filter",
}
"""Word of a menu → its meaning, if the word alone does not say it."""


def in_words(word: str) -> str:
    """A word as a menu shows it: its meaning with the name in code, "ZVD shaper · zvd", or the plain word."""
    return f"{WORDS[word]} · {word}" if word in WORDS else word


def options(path: str, scenario: Scenario | None = None) -> dict[str, Any]:
    """The words that the field at `path` allows, in a scenario or in the first part that has it, with their values."""
    field = path.removesuffix(".kind")
    owner, name = next(_places(field))
    if scenario is not None and "." in field:
        owner = cast("type[Part]", type(scenario.get(field.rpartition(".")[0])))
    annotation = owner.model_fields[name].annotation
    if path.endswith(".kind"):
        kinds = [part.model_fields["kind"].default for part in parts_of(annotation)]
        return dict(zip(kinds, kinds, strict=True))
    allowed = get_args(annotation) if get_origin(annotation) is Literal else ()
    return {word_of(value): value for value in allowed}


def _places(path: str) -> Iterator[tuple[type[Part], str]]:
    """The parts, of any kind, that have a field at a dotted path, each with the field's name."""
    name = path.rpartition(".")[2]
    return ((owner, name) for owner in _owners(path) if name in owner.model_fields)


def _owners(path: str) -> list[type[Part]]:
    """The parts, of any kind, that may hold the field at a dotted path."""
    owners: list[type[Part]] = [Scenario]
    for parent in path.split(".")[:-1]:
        fields = [owner.model_fields[parent] for owner in owners if parent in owner.model_fields]
        owners = [part for field in fields for part in parts_of(field.annotation)]
    return owners


def word_of(value: Any) -> str:
    """A menu's word for a value."""
    return f"{value:+d}".replace("-", "−") if isinstance(value, int) else str(value)


ENGINE = "trajectory.transition"
"""A field that only the engine sets: the transition after a change of the path in motion."""
FOLLOW = ("trajectory.table", "trajectory.table_of")
"""Fields that follow from the text of a person's own path and its options."""
Difference = tuple[str, Any, Any]
"""(dotted path, value in one, value in the other)."""


def part_differences(one: BaseModel, other: BaseModel, path: str = "") -> Iterator[Difference]:
    """Every field that differs; parts of different kinds, or a part and none, are one difference."""
    for name in type(one).model_fields:
        inner, old, new = f"{path}.{name}" if path else name, getattr(one, name), getattr(other, name)
        if isinstance(old, BaseModel) and type(old) is type(new):
            yield from part_differences(old, new, inner)
        elif old != new and inner != ENGINE:
            yield inner, old, new


def differences(one: BaseModel, other: BaseModel) -> list[Difference]:
    """Every single field that differs, except `SAID`; a field that only one of them has is None for the other."""
    found: list[Difference] = []
    for path, old, new in part_differences(one, other):
        first, second = dict(_leaves(_plain(old), path)), dict(_leaves(_plain(new), path))
        both = ((name, first.get(name), second.get(name)) for name in {**first, **second})
        found += [item for item in both if not item[0].startswith((*SAID, ENGINE, *FOLLOW)) and item[1] != item[2]]
    return found


def changes_towards(present: BaseModel, wanted: BaseModel) -> dict[str, Any]:
    """Changes by path that turn `present` into `wanted`, for `Scenario.replace`; a new kind comes before its fields."""
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
        for name, value in cast("dict[str, Any]", data).items():
            yield from _leaves(value, f"{path}.{name}")
    else:
        yield path, data


SIDES = {"left_arm": ", left arm", "right_arm": ", right arm"}
"""Arm → suffix that distinguishes the titles of its fields from the other arm's."""
DIGITS = 6
"""Digits shown of a value that somebody set."""
HASH_DIGITS = 6
"""Hexadecimal digits by which a reader tells a text of several lines, such as a law's, from another one."""


def field_title(path: str, *scenarios: Scenario) -> str:
    """A field's title with symbol and unit, from the first scenario that has it, or from any kind of its part; else `path`."""
    if path in TITLES:
        return TITLES[path]
    known = (scenario.about(path) for scenario in scenarios if scenario.has(path))
    about = next(known, None) or next((describe(*place) for place in _places(path)), None)
    if about is None:
        return path
    unit = f" ({about.unit})" if about.unit not in ("", "1") else ""
    return titled(about) + unit + SIDES.get(path.partition(".")[0], "")


def titled(about: Quantity) -> str:
    """Title and symbol of a field without the meaning of null, which is a word of scenario files."""
    title = re.sub(r" \(null: .*\)", "", about.title)
    return f"{title} {about.symbol}".strip()


def value_text(value: object) -> str:
    """A field's value as a short text."""
    if value is None:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return number_text(value, DIGITS)
    if isinstance(value, BaseModel):
        return value_text(value.model_dump())
    if isinstance(value, Mapping):
        fields = {str(name): inner for name, inner in cast("Mapping[str, Any]", value).items() if inner is not None}
        kind = fields.pop("kind", "")
        told = kind or ", ".join(f"{name.replace('_', ' ')} {value_text(inner)}" for name, inner in fields.items())
        return str(told) or MISSING
    if isinstance(value, (tuple, list)):
        return ", ".join(map(value_text, cast("Sequence[Any]", value)))
    text = str(value)
    lines = len(text.splitlines())
    return f"{lines} lines of text ({short_hash(text)[:HASH_DIGITS]})" if lines > 1 else text


_DOTTED = re.compile(r"[a-z_0-9]+(\.[a-z_0-9]+)*")
_SET = re.compile(r"(?<!\S)[a-z_0-9]+(\.[a-z_0-9]+)+(?= = )")
"""The path in "path = value", which events have for a field of one kind of a part, such as a damping ratio."""


def change_in_words(change: str) -> str:
    """A change of the preset, "path: old → new" in the notes of a run, or an event, with fields' titles for their paths."""
    path, colon, values = change.partition(": ")
    if colon and _DOTTED.fullmatch(path):
        return f"{field_title(path)}: {values}"
    return _SET.sub(lambda found: field_title(found[0]), change)


def told(differences: Iterable[Difference]) -> list[Difference]:
    """The differences without fields that only one kind of a part has, where that kind differs: it implies them."""
    found = list(differences)
    kinds = {path.removesuffix("kind") for path, _, _ in found if path.endswith(".kind")}
    return [
        (path, old, new)
        for path, old, new in found
        if not ((old is None or new is None) and any(path.startswith(kind) for kind in kinds)) or _of_every_kind(path)
    ]


def _of_every_kind(path: str) -> bool:
    """Whether every kind of a part has this field: None is then a value of it, such as continuous control."""
    return len(list(_places(path))) == len(_owners(path))
