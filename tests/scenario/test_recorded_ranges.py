"""What a field of a scenario accepts, it accepts in every later version, as recordings and scenario files may hold it.

`recorded_ranges.txt` lists all of it. After adding a field or widening one, write the file anew:
`python tests/scenario/test_recorded_ranges.py`. A range that has to become narrower needs a step in
`scenario.earlier_versions`, so that recordings open as before.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from flexlab.own.law import OwnController
from flexlab.own.path import OwnTrajectory
from flexlab.quantities import Part, describe, parts_of
from flexlab.scenario import Scenario

LISTED = Path(__file__).with_name("recorded_ranges.txt")
Accepted = tuple[float, float, float, float, frozenset[str]]
"""Smallest and largest number, smallest and largest length, and choices."""


def parts(model: type[Part]) -> Iterator[type[Part]]:
    """A part of a scenario and all parts in it, of every kind of flexlab's."""
    yield model
    for field in model.model_fields.values():
        for part in parts_of(field.annotation):
            if not issubclass(part, (OwnController, OwnTrajectory)):
                yield from parts(part)


def name_of(model: type[Part]) -> str:
    """The kind of a law, a path and the like; the class's name for other parts."""
    kind = model.model_fields.get("kind")
    return model.__name__ if kind is None else str(kind.default)


def choices(annotation: Any) -> frozenset[str]:
    """The choices that a field's type names, None included."""
    if get_origin(annotation) is Literal:
        return frozenset(map(repr, get_args(annotation)))
    return frozenset({"None"} if annotation is type(None) else set()).union(*map(choices, get_args(annotation)))


def accepted() -> dict[str, Accepted]:
    """Field, with the name of its part, → what it accepts."""
    found: dict[str, Accepted] = {}
    for model in parts(Scenario):
        for name, field in model.model_fields.items():
            about = describe(model, name)
            shortest = max([item.min_length for item in field.metadata if hasattr(item, "min_length")], default=0)
            longest = min(
                [item.max_length for item in field.metadata if hasattr(item, "max_length")], default=float("inf")
            )
            found[f"{name_of(model)}.{name}"] = about.low, about.high, shortest, longest, choices(field.annotation)
    return found


def listing() -> str:
    """Return a line for each field: its name, range of numbers, range of lengths, and choices, with tabs between them."""
    lines = ["\t".join([field, *map(repr, about[:4]), *sorted(about[4])]) for field, about in accepted().items()]
    return "\n".join(sorted(lines)) + "\n"


def test_no_field_accepts_less_than_recordings_may_hold():
    now, listed = accepted(), [line.split("\t") for line in LISTED.read_text(encoding="utf-8").splitlines()]
    for field, low, high, shortest, longest, *chosen in listed:
        assert field in now, f"{field} is in recordings"
        about = now[field]
        assert about[0] <= float(low) <= float(high) <= about[1], field
        assert about[2] <= float(shortest) <= float(longest) <= about[3], field
        assert about[4] >= set(chosen), field


def test_no_part_needs_a_field_that_recordings_lack():
    listed = {line.split()[0] for line in LISTED.read_text(encoding="utf-8").splitlines()}
    known = {field.rpartition(".")[0] for field in listed}
    needed = {
        f"{name_of(model)}.{name}"
        for model in parts(Scenario)
        for name, field in model.model_fields.items()
        if field.is_required() and name_of(model) in known
    }
    assert needed <= listed


if __name__ == "__main__":
    LISTED.write_text(listing(), encoding="utf-8")
