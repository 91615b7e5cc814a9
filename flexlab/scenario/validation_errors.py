"""What is wrong with a scenario, in sentences."""

import math
import reprlib
from collections.abc import Iterable, Sequence
from typing import Any

from flexlab.quantities import Part, Quantity, describe, parts_of
from flexlab.scenario.field_names import close_paths, did_you_mean, field_paths
from flexlab.text import number_text, visible

LONGEST = 60
"""Characters of a name or value that a sentence repeats."""


def locate(model: type[Part], location: Sequence[Any]) -> tuple[str, Quantity | None, list[type[Part]]]:
    """Dotted path and description of the place that pydantic names, where unions put the kind they chose in between.

    Also the parts that may stand there: none where a value stands, or nothing known.
    """
    owners, names, about = [model], [], None
    for item in map(str, location):
        chosen = [
            owner for owner in owners if "kind" in owner.model_fields and owner.model_fields["kind"].default == item
        ]
        if chosen:
            owners = chosen
            continue
        names.append(item if len(item) <= LONGEST and (item.isidentifier() or item.isdecimal()) else _shown(item))
        holders = [owner for owner in owners if item in owner.model_fields]
        if holders:
            about = describe(holders[0], item)
        owners = [part for owner in holders for part in parts_of(owner.model_fields[item].annotation)]
    return ".".join(names), about, owners


def unknown_field(path: str, here: Iterable[str], anywhere: Iterable[str] = ()) -> str:
    """The sentence about a path that is no field: `here` are the fields where it was given, `anywhere` all there are."""
    elsewhere = set(anywhere)
    if path in elsewhere:
        return f"{path} is not a scenario field here but one of another kind: choose that kind first, or remove it."
    close = close_paths(path, here) or close_paths(path, elsewhere)
    return f"{path} is not a scenario field: {did_you_mean(close)}"


def problem(model: type[Part], item: Any) -> tuple[str, str]:
    """(path, sentence) for one pydantic error in data for `model`."""
    path, about, _ = locate(model, item["loc"])
    unit = about.unit_text() if about else ""
    shown = _shown(item["input"])
    kind, text = item["type"], item["msg"]
    if kind == "extra_forbidden":
        above, _, owners = locate(model, item["loc"][:-1])
        here = [f"{above}.{name}" if above else name for owner in owners for name in owner.model_fields]
        return path, unknown_field(path, here, field_paths(model))
    if kind == "missing":
        return path, f"{path} is missing: give it a value."
    if kind == "range":
        return path, f"{path} = {shown}{unit} {text}: choose a value within it."
    if kind in ("number", "numbers"):
        allowed = f" (allowed: {about.range_text()})" if about and math.isfinite(about.low) else ""
        return path, f"{path} = {shown} {text}{allowed}."
    if kind == "literal_error":
        return path, f"{path} = {shown} is not one of {item['ctx']['expected']}: choose one of them."
    if kind == "union_tag_invalid":
        tag, known = _shown(item["ctx"]["tag"]), item["ctx"]["expected_tags"]
        return path, f"{path}.kind = {tag} is not one of {known}: choose one of them."
    if kind == "union_tag_not_found":
        return path, f"{path}.kind is missing: give it a value."
    if kind in ("model_type", "model_attributes_type"):
        return path, f"{path} = {shown} is not usable: it has fields of its own, so give a dictionary of them."
    if kind == "string_type":
        return path, f"{path} = {shown} is not usable: give a text."
    if kind in ("mesh", "arms", "inertia", "sampling", "integrator", "path"):
        return path, f"{path + ': ' if path else ''}{text}."
    return path, f"{path} = {shown}: {text}."


class _Brief(reprlib.Repr):
    """Says a value as `repr` does, but of one that is large or deep not all."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 4
        self.maxtuple = self.maxlist = self.maxarray = self.maxdict = self.maxset = self.maxfrozenset = LONGEST // 3
        self.maxstring = self.maxlong = self.maxother = 3 * LONGEST

    def repr_int(self, x: int, level: int) -> str:
        return super().repr_int(x, level) if abs(x) < 10**LONGEST else "a number with too many digits"


def _shown(value: Any) -> str:
    text = _number(value) if isinstance(value, float) else visible(_Brief().repr(value))
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."


def _number(value: float) -> str:
    text = f"{value:g}"
    return number_text(value) if "e" in text else text
