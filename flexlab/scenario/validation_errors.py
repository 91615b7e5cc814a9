"""The names of all scenario fields, what a misspelt one may mean, and what is wrong with a scenario, in sentences."""

import difflib
import math
import reprlib
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from flexlab.quantities import Part, Quantity, describe, parts_of
from flexlab.text import number_text, visible

MOST_HINTS = 3
"""The most names in a sentence."""
ALIKE, ALIKE_LAST = 0.75, 0.8
"""Least similarity, 0 to 1, of a path, or its last name, to one that it may misspell."""
NEARLY_AS_GOOD = 0.1
"""Names that are less similar than the best by no more than this are suggested too."""


def field_paths(model: type[Part], before: str = "") -> Iterator[str]:
    """The dotted path of every field that a scenario part may have, of every kind, parts included."""
    for name, field in model.model_fields.items():
        path = f"{before}.{name}" if before else name
        yield path
        for part in parts_of(field.annotation):
            yield from field_paths(part, path)


def value_paths(part: Part, before: str = "") -> Iterator[str]:
    """The dotted path of every field that a part has, parts included."""
    for name in type(part).model_fields:
        path = f"{before}.{name}" if before else name
        yield path
        inner = getattr(part, name)
        if isinstance(inner, Part):
            yield from value_paths(inner, path)


def _ratio(pair: difflib.SequenceMatcher[str], least: float) -> float:
    """The similarity of two texts, 0 to 1; 0 if it is below `least`, as its bounds, found sooner, tell for most pairs."""
    if pair.real_quick_ratio() < least or pair.quick_ratio() < least:
        return 0.0
    ratio = pair.ratio()
    return ratio if ratio >= least else 0.0


def close_paths(path: str, known: Iterable[str]) -> list[str]:
    """Up to `MOST_HINTS` known paths that `path` may mean, by similar spelling of the path or of its last name."""
    paths = sorted(set(known))
    last = path.rpartition(".")[2].lower()

    def likeness(other: str) -> float:
        same_end = difflib.SequenceMatcher(None, last, other.rpartition(".")[2])
        whole = difflib.SequenceMatcher(None, path.lower(), other)
        likely = max(_ratio(whole, ALIKE), _ratio(same_end, ALIKE_LAST))
        return likely + whole.ratio() / 100 if likely else 0.0

    ranked = sorted(((likeness(other), other) for other in paths), key=lambda item: -item[0])
    enough = max(ALIKE, ranked[0][0] - NEARLY_AS_GOOD) if ranked else 1.0
    return [other for score, other in ranked if score >= enough][:MOST_HINTS]


def did_you_mean(names: list[str]) -> str:
    """The end of a sentence about a misspelt name, after its colon."""
    if not names:
        return "check the spelling or remove it."
    return f"did you mean {' or '.join((', '.join(names[:-1]), names[-1]) if names[1:] else names)}?"


LONGEST = 60
"""Characters of a name or value that a sentence repeats."""


def locate(model: type[Part], location: Sequence[Any]) -> tuple[str, Quantity | None, list[type[Part]]]:
    """Dotted path and description of the place that pydantic names, without the kinds that it inserts for unions.

    Also the parts that may be there: none for a value or an unknown place.
    """
    owners, about = [model], None
    names: list[str] = []
    for item in map(str, location):
        chosen = [
            owner for owner in owners if "kind" in owner.model_fields and owner.model_fields["kind"].default == item
        ]
        if chosen and chosen != owners:  # A field may be named as the kind that is chosen already.
            owners = chosen
            continue
        names.append(item if len(item) <= LONGEST and (item.isidentifier() or item.isdecimal()) else brief(item))
        holders = [owner for owner in owners if item in owner.model_fields]
        if holders:
            about = describe(holders[0], item)
        owners = [part for owner in holders for part in parts_of(owner.model_fields[item].annotation)]
    return ".".join(names), about, owners


def unknown_field(path: str, here: Iterable[str], anywhere: Iterable[str] = ()) -> str:
    """The sentence about a path that is not a field; `here`: fields at its place, `anywhere`: all fields."""
    elsewhere = set(anywhere)
    if path in elsewhere:
        return f"{path} is not a scenario field here but one of another kind: choose that kind first, or remove it."
    close = close_paths(path, here) or close_paths(path, elsewhere)
    return f"{path} is not a scenario field: {did_you_mean(close)}"


def problem(model: type[Part], item: Any) -> tuple[str, str]:
    """(path, sentence) for one pydantic error in data for `model`."""
    path, about, parts = locate(model, item["loc"])
    unit = about.unit_text() if about else ""
    shown = brief(item["input"])
    kind, text = item["type"], item["msg"]
    if kind == "extra_forbidden":
        above, _, owners = locate(model, item["loc"][:-1])
        here = [f"{above}.{name}" if above else name for owner in owners for name in owner.model_fields]
        known, key = field_paths(model), str(item["loc"][-1])
        if "." in key and (f"{above}.{key}" if above else key) in known:
            nested = ": {".join(f'"{name}"' for name in key.split(".")) + ": …" + "}" * key.count(".")
            return path, f"{path} names a field by its path: nest it, as in {{{nested}}}."
        return path, unknown_field(path, here, known)
    if kind == "string_unicode" and parts:  # A name with half a character: pydantic names the part that holds it.
        name = f"{path}.{shown}" if path else shown
        return name, unknown_field(name, field_paths(model))
    if kind == "missing":
        return path, f"{path} is missing: give it a value."
    if kind == "range":
        return path, f"{path} = {shown}{unit} {text}: choose a value within it."
    if kind in ("number", "numbers"):
        allowed = f" (allowed: {about.range_text()})" if about and math.isfinite(about.low) else ""
        return path, f"{path} = {shown} {text}{allowed}."
    if kind == "literal_error":
        return path, f"{path} = {shown} is not one of {item['ctx']['expected']}: choose one of them."
    if kind == "int_parsing_size":  # A number beyond 64 bits where pydantic knows a few numbers only.
        return path, f"{path} = {shown} is not usable: give a whole number of fewer digits."
    if kind == "union_tag_invalid":
        tag, known = brief(item["ctx"]["tag"]), item["ctx"]["expected_tags"]
        return path, f"{path}.kind = {tag} is not one of {known}: choose one of them."
    if kind == "union_tag_not_found":
        return path, f"{path}.kind is missing: give it a value."
    if kind in ("model_type", "model_attributes_type"):
        return path, f"{path} = {shown} is not usable: it has fields of its own, so give a dictionary of them."
    if kind in ("string_type", "string_unicode"):
        return path, f"{path} = {shown} is not usable: give a text."
    if kind == "string_too_long":
        return (
            path,
            f"{path} has {len(item['input'])} characters: {item['ctx']['max_length']} are the most, shorten it.",
        )
    if kind == "tuple_type":
        return path, f"{path} = {shown} is not usable: give a list."
    if kind == "too_short":
        return path, f"{path} = {shown} has too few usable entries: give {item['ctx']['min_length']} or more."
    if kind == "too_long":
        return path, f"{path} has too many entries: {item['ctx']['max_length']} are the most."
    if kind in ("mesh", "arms", "inertia", "sampling", "integrator", "path"):
        return path, f"{path + ': ' if path else ''}{text}."
    return path, f"{path} = {shown}: {text}."


class _Brief(reprlib.Repr):
    """As `repr`, but shortens large or deep values."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 4
        self.maxtuple = self.maxlist = self.maxarray = self.maxdict = self.maxset = self.maxfrozenset = LONGEST // 3
        self.maxstring = self.maxlong = self.maxother = 3 * LONGEST

    def repr_int(self, x: int, level: int) -> str:
        return super().repr_int(x, level) if abs(x) < 10**LONGEST else "a number with too many digits"


def brief(value: Any) -> str:
    """A value of any type and size in at most `LONGEST` characters."""
    text = f"{value:g}" if isinstance(value, float) else visible(_Brief().repr(value))
    if isinstance(value, float) and "e" in text:
        text = number_text(value)
    return text if len(text) <= LONGEST else text[: LONGEST - 3] + "..."
