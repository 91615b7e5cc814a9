"""The names of all scenario fields, as people type them, and which of them a misspelt one may mean."""

import difflib
from collections.abc import Iterable, Iterator

from flexlab.quantities import Part, parts_of

MOST_HINTS = 3
"""Names in a sentence."""
ALIKE, ALIKE_LAST = 0.75, 0.8
"""How alike, of 1, two paths or their last names are for one to pass for a misspelt other."""

NEARLY_AS_GOOD = 0.1
"""Which are named beside the most alike."""


def field_paths(model: type[Part], before: str = "") -> Iterator[str]:
    """The dotted path of every field that a scenario part may have, of every kind, parts included."""
    for name, field in model.model_fields.items():
        path = f"{before}.{name}" if before else name
        yield path
        for part in parts_of(field.annotation):
            yield from field_paths(part, path)


def value_paths(part: Part, before: str = "") -> Iterator[str]:
    """The dotted path of every field that a part has as it is, parts included."""
    for name in type(part).model_fields:
        path = f"{before}.{name}" if before else name
        yield path
        inner = getattr(part, name)
        if isinstance(inner, Part):
            yield from value_paths(inner, path)


def close_paths(path: str, known: Iterable[str]) -> list[str]:
    """Up to `MOST_HINTS` of the known paths that `path` may mean: those spelt alike, or that end in a name like its own."""
    paths = sorted(set(known))
    last = path.rpartition(".")[2].lower()

    def likeness(other: str) -> float:
        end = other.rpartition(".")[2]
        same_end = difflib.SequenceMatcher(None, last, end).ratio()
        whole = difflib.SequenceMatcher(None, path.lower(), other).ratio()
        return max(whole if whole >= ALIKE else 0.0, same_end if same_end >= ALIKE_LAST else 0.0) + whole / 100

    ranked = sorted(((likeness(other), other) for other in paths), key=lambda item: -item[0])
    enough = max(ALIKE, ranked[0][0] - NEARLY_AS_GOOD) if ranked else 1.0
    return [other for score, other in ranked if score >= enough][:MOST_HINTS]


def did_you_mean(names: list[str]) -> str:
    """The end of a sentence about a misspelt name, after its colon."""
    if not names:
        return "check the spelling or remove it."
    return f"did you mean {' or '.join((', '.join(names[:-1]), names[-1]) if names[1:] else names)}?"
