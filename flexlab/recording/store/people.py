"""Names of those who recorded runs; where two have one name, each has a mark behind it."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from flexlab.recording.store.run_files import list_files
from flexlab.recording.store.run_index import RunRow, whose

MARK = 4
"""Characters of an owner's mark behind a name that others have, too."""


def names_told_apart(people: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """(Name, mark of their runs) → the name, with the beginning of the mark where others have the same name."""
    known = set(people)
    count = Counter(name for name, _ in known)
    return {
        (name, owner): f"{name} ({owner[:MARK]})" if name and owner and count[name] > 1 else name
        for name, owner in known
    }


def told_apart(rows: Sequence[RunRow], logs: Path) -> list[RunRow]:
    """Runs with their visitors' names told apart from all that are in the notes of a folder."""
    if not any(row.visitor and row.owner for row in rows):
        return list(rows)
    names = names_told_apart([*map(whose, list_files(logs)), *((row.visitor, row.owner) for row in rows)])
    return [replace(row, visitor=names[row.visitor, row.owner]) for row in rows]
