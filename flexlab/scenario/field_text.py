"""A scenario's fields in the words of screen, pages and tables: what a field is called, what its value is, what differs."""

from collections.abc import Iterable, Mapping

from pydantic import BaseModel

from flexlab.number_text import MISSING, number_text
from flexlab.quantities import Part, Quantity, describe, parts_of
from flexlab.scenario.choices import TITLES
from flexlab.scenario.differences import Difference
from flexlab.scenario.scenario import Scenario

SIDES = {"left_arm": ", left arm", "right_arm": ", right arm"}
"""Part of the scenario → what tells its fields from those of the same names in another part."""
DIGITS = 6
"""Of a value that somebody set."""


def field_title(path: str, *scenarios: Scenario) -> str:
    """A field's title with symbol and unit, as the first scenario that has it says, or any kind of its part; else `path`."""
    if path in TITLES:
        return TITLES[path]
    about = next((scenario.about(path) for scenario in scenarios if scenario.has(path)), None) or _of_any_kind(path)
    if about is None:
        return path
    unit = f" ({about.unit})" if about.unit not in ("", "1") else ""
    return f"{about.title} {about.symbol}".strip() + unit + SIDES.get(path.partition(".")[0], "")


def _of_any_kind(path: str) -> Quantity | None:
    *parents, name = path.split(".")
    owners: list[type[Part]] = [Scenario]
    for parent in parents:
        fields = [owner.model_fields[parent] for owner in owners if parent in owner.model_fields]
        owners = [part for field in fields for part in parts_of(field.annotation)]
    return next((describe(owner, name) for owner in owners if name in owner.model_fields), None)


def value_text(value: object) -> str:
    """A field's value in the fewest words."""
    if value is None:
        return MISSING
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, (int, float)):
        return number_text(value, DIGITS)
    if isinstance(value, BaseModel):
        return value_text(value.model_dump())
    if isinstance(value, Mapping):
        fields = {str(name): inner for name, inner in value.items() if inner is not None}
        kind = fields.pop("kind", "")
        told = kind or ", ".join(f"{name.replace('_', ' ')} {value_text(inner)}" for name, inner in fields.items())
        return str(told) or MISSING
    if isinstance(value, (tuple, list)):
        return ", ".join(map(value_text, value))
    return str(value)


def told(differences: Iterable[Difference]) -> list[Difference]:
    """The differences that are news: not each field of a part whose kind is another one, which the kind implies."""
    found = list(differences)
    kinds = {path.removesuffix("kind") for path, _, _ in found if path.endswith(".kind")}
    return [
        (path, old, new)
        for path, old, new in found
        if not ((old is None or new is None) and any(path.startswith(kind) for kind in kinds))
    ]
