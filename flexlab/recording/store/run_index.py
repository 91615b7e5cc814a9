"""The runs in the logs folder as a table lists them: told from file names, notes and states, without reading runs."""

import contextlib
import logging
import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from flexlab.errors import RecordingError
from flexlab.recording.store.run_files import (
    SUFFIX,
    TIME_FORMAT,
    list_runs,
    read_notes,
    remove_run,
    run_state,
    write_notes,
)

LONGEST_NOTE = 2000
"""Characters of a person's note on a run."""
LONGEST_TAGS = 200
"""Characters of all tags of a run."""
_NAME = re.compile(r"(\d{4}-\d{2}-\d{2}T\d{2}-\d{2}-\d{2})-(.+)")

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class RunRow:
    """One run in a table."""

    id: str
    """File name without its ending: the run's address."""
    path: Path
    preset: str
    started: datetime
    begins: float
    """Simulation time of its first sample, s: not 0 if it went on from another run."""
    duration: float | None
    """Simulated, s; None if its writer did not live to say."""
    size: int
    """Bytes."""
    state: str
    status: str
    """How the run ended."""
    metrics: dict[str, Any]
    """Title with unit → value; empty for a run that was not measured yet."""
    changes: tuple[str, ...]
    """What differs from the preset, a line each."""
    note: str
    tags: tuple[str, ...]
    kept: bool
    """Whether it may not be deleted."""


def list_rows(logs: Path) -> list[RunRow]:
    """All runs, newest first; files that vanish meanwhile are left out."""
    rows = []
    for path in list_runs(logs):
        try:
            rows.append(read_row(path))
        except OSError:
            continue
    return rows


def newest_rows(logs: Path, count: int) -> list[RunRow]:
    """The newest runs."""
    rows = []
    for path in list_runs(logs)[:count]:
        try:
            rows.append(read_row(path))
        except OSError:
            continue
    return rows


def find_row(logs: Path, run: str) -> RunRow:
    """One run. Raises `RecordingError` if there is none with this name."""
    # Looked up among the files that are there: a name from an address never becomes a path.
    for path in list_runs(logs):
        if path.stem == run:
            try:
                return read_row(path)
            except OSError:
                break
    raise RecordingError(f"There is no run {run}: it may have been deleted. The library shows what there is.")


def check_removable(row: RunRow) -> None:
    """Raise `RecordingError` if a run may not be deleted: it is kept, or being written."""
    if row.kept:
        raise RecordingError(f"{row.id} is marked to be kept: take that mark away first.")
    if row.state == "in use":
        raise RecordingError(f"{row.id} is still being recorded: it can be deleted when its run has ended.")


def delete_run(row: RunRow) -> None:
    """Delete a run's file and notes. Raises `RecordingError` if it may not or cannot be deleted."""
    check_removable(row)
    remove_run(row.path)
    log.info("Deleted the run %s.", row.id)


def annotate_run(row: RunRow, note: str, tags: str, kept: bool) -> None:
    """Write a person's note, tags (separated by commas) and mark. Raises `RecordingError`."""
    if len(note) > LONGEST_NOTE:
        raise RecordingError(f"This note has {len(note)} characters: at most {LONGEST_NOTE} fit.")
    if len(tags) > LONGEST_TAGS:
        raise RecordingError(f"These tags have {len(tags)} characters: at most {LONGEST_TAGS} fit.")
    words = list(dict.fromkeys(word.strip() for word in tags.split(",") if word.strip()))
    try:
        write_notes(row.path, note=note.strip(), tags=words, keep=kept)
    except OSError as error:
        raise RecordingError(f"The note on {row.id} cannot be written ({error.strerror}).") from None


def read_row(path: Path) -> RunRow:
    """The row of a recording. Raises OSError if it is gone."""
    notes, stat = read_notes(path), path.stat()
    named = _NAME.fullmatch(path.stem)
    started = _time(notes.get("started")) or (named and _time(named[1])) or datetime.fromtimestamp(stat.st_mtime)
    preset = named[2] if named else path.stem
    metrics, begins, duration = notes.get("metrics"), notes.get("begins"), notes.get("duration")
    return RunRow(
        id=path.name.removesuffix(SUFFIX),
        path=path,
        preset=str(notes.get("preset", preset)),
        started=started,
        begins=float(begins) if isinstance(begins, (int, float)) else 0.0,
        duration=float(duration) if isinstance(duration, (int, float)) else None,
        size=stat.st_size,
        state=run_state(path),
        status=str(notes.get("status", "")),
        metrics=metrics if isinstance(metrics, dict) else {},
        changes=_texts(notes.get("changes")),
        note=str(notes.get("note", "")),
        tags=_texts(notes.get("tags")),
        kept=bool(notes.get("keep", False)),
    )


def _time(text: Any) -> datetime | None:
    """Local time as the notes or a file's name say it; None for anything else."""
    for read in (datetime.fromisoformat, lambda words: datetime.strptime(words, TIME_FORMAT)):
        with contextlib.suppress(ValueError, TypeError):
            return read(text).replace(tzinfo=None)
    return None


def _texts(value: Any) -> tuple[str, ...]:
    return tuple(map(str, value)) if isinstance(value, list) else ()


def state_word(row: RunRow) -> str:
    """The state for people."""
    return "recording" if row.state == "in use" else row.state


def size_text(size: float) -> str:
    """Bytes in a unit for people."""
    for unit in ("B", "kB", "MB"):
        if size < 1000:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"


def duration_text(duration: float | None) -> str:
    """Simulated time for people."""
    if duration is None:
        return "–"
    if duration < 120:
        return f"{duration:.4g} s"
    return f"{int(duration // 60)} min {duration % 60:02.0f} s"
