"""Whose runs they are: the visitors of a class in the notes of a folder, told apart where several have one name."""

from collections import Counter
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Any

from flexlab.recording.store.notes import notes_path, read_notes
from flexlab.recording.store.run_files import list_files
from flexlab.text import visible

LONGEST_NAME = 200
"""Largest length of a person's or preset's name, or of a status, that is shown, characters."""
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


def whose(notes: dict[str, Any]) -> tuple[str, str]:
    """(name, mark) of the visitor who made a recording; empty for nobody in particular."""
    return visible(notes.get("visitor", ""), LONGEST_NAME), visible(notes.get("owner", ""), LONGEST_NAME)


def owner_of(path: Path) -> str:
    """The mark of the visitor who made a recording; empty for nobody in particular."""
    return _person(path)[1]


@lru_cache(maxsize=1)  # The teacher's page asks every 0.4 s.
def _recorded(logs: Path, changed: int) -> frozenset[tuple[str, str]]:
    """All people in the notes of a folder, whose time stamp is `changed`: new notes replace the file of the old ones."""
    return frozenset(map(_person, list_files(logs)))


def _person(path: Path) -> tuple[str, str]:
    """`whose` of a recording's notes, which are read once for each change."""
    try:
        return _noted(path, notes_path(path).lstat().st_mtime_ns)
    except OSError:  # It has no notes.
        return "", ""


# For a class's runs of a term: reading all notes takes a second, and the folder changes every few.
@lru_cache(maxsize=20_000)
def _noted(path: Path, changed: int) -> tuple[str, str]:
    return whose(read_notes(path))
