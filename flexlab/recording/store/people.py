"""Names of people who recorded runs; a mark follows a name that several have."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from flexlab.recording.store.run_files import list_files
from flexlab.recording.store.run_index import RunRow, whose

JOINERS = {0x200C: None, 0x200D: None}
"""Characters within a name that nobody sees, or only by the shape of their neighbours."""
MARK = 4
"""Length of the owner's mark behind a name that several have, characters."""


def names_told_apart(people: Iterable[tuple[str, str]], logs: Path) -> dict[tuple[str, str], str]:
    """(name, mark of their runs) → the name, with the beginning of the mark if others have the same name.

    Others are among these people or in the notes of a folder.
    """
    known = _recorded(logs, logs.stat().st_mtime_ns if logs.exists() else 0).union(people)
    count = Counter(name.translate(JOINERS) for name, _ in known)
    return {
        (name, owner): f"{name} ({owner[:MARK]})" if name and owner and count[name.translate(JOINERS)] > 1 else name
        for name, owner in known
    }


def told_apart(rows: Sequence[RunRow], logs: Path) -> list[RunRow]:
    """Runs with their visitors' names told apart from all other names in the notes of a folder."""
    if not any(row.visitor and row.owner for row in rows):
        return list(rows)
    names = names_told_apart(((row.visitor, row.owner) for row in rows), logs)
    return [replace(row, visitor=names[row.visitor, row.owner]) for row in rows]


@lru_cache(maxsize=1)  # The teacher's page asks every 0.4 s.
def _recorded(logs: Path, changed: int) -> frozenset[tuple[str, str]]:
    """All people in the notes of a folder, whose time stamp is `changed`: new notes replace the file of the old ones."""
    return frozenset(map(whose, list_files(logs)))
