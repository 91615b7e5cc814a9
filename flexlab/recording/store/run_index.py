"""The runs in the logs folder as tables list them, from file names, notes and states; recordings are not read."""

import contextlib
import logging
import math
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import quote

from flexlab.errors import RecordingError
from flexlab.guide import LessonProgress
from flexlab.recording.store.notes import read_notes, write_notes
from flexlab.recording.store.people import LONGEST_NAME, names_told_apart, owner_of, whose
from flexlab.recording.store.run_files import (
    BREAKING_OFF,
    BREAKS_OFF,
    SUFFIX,
    TIME_FORMAT,
    check_own_recording,
    list_files,
    remove_run,
    run_state,
)
from flexlab.text import number_text, visible

LONGEST_NOTE = 2000
"""Largest length of a person's note on a run, characters."""
LONGEST_TAGS = 200
"""Largest length of all tags of a run, characters."""
LONGEST_CHANGE, MOST_CHANGES = 500, 1000
"""Largest length of a line about a change, characters, and largest number of lines."""
MOST_METRICS = 100
MOST_LESSONS = 100
MEASURED_STATUS = "measured"
"""`sim.samples.MEASURED`, written again here so that listing runs does not load the engine."""
_NO_ADDRESS = re.compile(r"[\\\t\n{}]|\A\.*\Z|\.rrd\Z")
"""Found in names that an address cannot hold, or that would mean something else there."""
_NAME = re.compile(r"(\d{4}-\d{2}-\d{2}T\d{2}-\d{2}-\d{2})-(.+)")
OPEN_LESSON = "lesson"
"""Key in the notes: the open lesson of the visitor's lab and its progress, as in `LabStatus`; empty if none was open."""
LEAST_SHARE = 0.01
"""Smallest share of missing samples that is told as it is, %."""
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class RunRow:
    """One run in a table."""

    id: str
    """File name without its ending; a name that is no text is encoded in characters that an address may hold."""
    path: Path
    preset: str
    started: datetime
    begins: float
    """Simulation time of its first sample, s: not 0 if it continued another run."""
    duration: float | None
    """Simulated time, s; None if its writer died before noting it."""
    size: int
    """Bytes."""
    state: str
    status: str
    """How the run ended; empty if that is not known."""
    metrics: dict[str, float | None]
    """Title with unit → value; empty for a run whose metrics were not computed yet."""
    changes: tuple[str, ...]
    """A line for each difference from the preset."""
    note: str
    tags: tuple[str, ...]
    kept: bool
    """Whether a person has marked the run to be kept: it is not deleted."""
    owner: str = ""
    """Mark of the visitor who recorded it; empty for nobody in particular."""
    visitor: str = ""
    """Name of that visitor."""
    lessons: tuple[LessonProgress, ...] = ()
    """Guesses made and lessons passed in the lab that recorded it."""
    own_metrics: tuple[str, ...] = ()
    """Names of the metrics that a person declared for their own studies."""
    why_stopped: str = ""
    """Why the run stopped before its end, as a sentence; "" if it did not, or if the reason was not noted."""
    breaks_off: str = ""
    """Why the end of the run is not recorded, as a sentence; "" if it is, or if the reason was not noted."""
    gaps: str = ""
    """How much of the run is missing because the machine was too busy to write it, as a sentence; "" if nothing is."""
    problem: str = ""
    """Why the file is not a recording, as a sentence; it can then only be deleted."""

    @property
    def is_measured(self) -> bool:
        """Whether it was measured and not simulated: it can then be neither continued nor replayed."""
        return self.status == MEASURED_STATUS

    @property
    def is_stopped(self) -> bool:
        """Whether the run stopped before its end; its metrics are then no results."""
        return self.status not in ("", "finished", MEASURED_STATUS)

    @property
    def heading(self) -> str:
        """Time of its start, visitor and tags, in a line."""
        return " · ".join(filter(None, (f"{self.started:%Y-%m-%d %H:%M:%S}", self.visitor, ", ".join(self.tags))))

    @property
    def address(self) -> str:
        """`id` as part of an address."""
        return quote(self.id, safe="")


def list_rows(logs: Path) -> list[RunRow]:
    """All runs, newest first; files that vanish meanwhile are left out."""
    return list(read_rows(list_files(logs)))


def read_rows(paths: Iterable[Path]) -> Iterator[RunRow]:
    """The rows of these files; files that vanish meanwhile are left out."""
    for path in paths:
        with contextlib.suppress(OSError):
            yield read_row(path)


def find_row(logs: Path, run: str) -> RunRow:
    """The row of a run by its `id`. Raises `NoSuchRun`."""
    return find_rows(logs, [run])[0]


def find_rows(logs: Path, runs: Iterable[str]) -> list[RunRow]:
    """The rows of runs by their `id`s, in one pass over the folder. Raises `NoSuchRun`."""
    # Found among the files of the folder: a name from an address never becomes a path.
    files = {run_id(path): path for path in list_files(logs)}
    rows: list[RunRow] = []
    for run in runs:
        try:
            rows.append(read_row(files[run]))
        except (KeyError, OSError):
            raise NoSuchRun(run) from None
    return rows


class NoSuchRun(RecordingError):
    """No run has this name."""

    def __init__(self, run: str):
        super().__init__(
            f"There is no run {visible(run, LONGEST_NAME)}: it may have been deleted. The library shows what there is."
        )


def run_id(path: Path) -> str:
    """The word by which pages and people name a recording."""
    stem = path.name.removesuffix(SUFFIX)
    if visible(stem) == stem and not _NO_ADDRESS.search(stem):
        return stem
    return quote(os.fsencode(path.name), safe="").replace(".", "%2E")


def last_lessons(logs: Path, owner: str) -> tuple[str, tuple[LessonProgress, ...]]:
    """The open lesson and the progress in all, by the notes on the last run of a visitor's lab; empty if there is none."""
    for path in list_files(logs):
        if owner_of(path) == owner and OPEN_LESSON in (notes := read_notes(path)):
            return visible(notes[OPEN_LESSON], LONGEST_CHANGE), _lessons(notes.get("lessons"))
    return "", ()


def check_removable(row: RunRow) -> None:
    """Raise `RecordingError` if a run may not be deleted: it is kept, or being written."""
    if row.kept:
        raise RecordingError(f"{row.id} is marked to be kept: remove that mark first.")
    if row.state == "in use":
        raise RecordingError(f"{row.id} is still being recorded: it can be deleted when its run has ended.")


def delete_run(row: RunRow) -> None:
    """Delete a run's file and notes. Raises `RecordingError` if it may not or cannot be deleted."""
    with contextlib.suppress(OSError):  # Somebody else has deleted it.
        check_removable(read_row(row.path))  # It may have been marked since `row` was read.
    remove_run(row.path)
    log.info("Deleted the run %s.", row.id)


def annotate_run(row: RunRow, note: str | None = None, tags: str | None = None, kept: bool | None = None) -> None:
    """Write a person's note, tags (separated by commas) and mark; None leaves one as it is. Raises `RecordingError`."""
    changes: dict[str, Any] = {}
    if note is not None:
        if len(note) > LONGEST_NOTE:
            raise RecordingError(f"This note has {len(note)} characters: at most {LONGEST_NOTE} fit.")
        changes["note"] = note.strip()
    if tags is not None:
        if len(tags) > LONGEST_TAGS:
            raise RecordingError(f"These tags have {len(tags)} characters: at most {LONGEST_TAGS} fit.")
        changes["tags"] = list(dict.fromkeys(word.strip() for word in tags.split(",") if word.strip()))
    if kept is not None:
        changes["keep"] = kept
    try:
        write_notes(row.path, **changes)
    except OSError as error:
        raise RecordingError(f"The note on {row.id} cannot be written ({error.strerror}).") from None


def read_row(path: Path) -> RunRow:
    """The row of a recording, whatever its notes or the file itself are. Raises OSError if it is gone."""
    stat, problem = path.lstat(), ""
    notes = read_notes(path)
    state = "damaged" if path.is_symlink() else run_state(path, notes)
    try:
        check_own_recording(path)
    except RecordingError as error:
        problem = str(error) if state != "in use" else f"{run_id(path)} has only just begun: look again in a moment."
    visitor, owner = whose(notes)
    metrics = notes["metrics"] if isinstance(notes.get("metrics"), dict) else {}
    status = visible(notes.get("status", ""), LONGEST_NAME)
    named = _NAME.fullmatch(path.stem)
    started = _time(notes.get("started")) or (named and _time(named[1])) or _time(stat.st_mtime)
    return RunRow(
        id=run_id(path),
        path=path,
        preset=visible(notes.get("preset", named[2] if named else run_id(path)), LONGEST_NAME),
        started=started or datetime.min,
        begins=_number(notes.get("begins")) or 0.0,
        duration=_number(notes.get("duration")),
        size=stat.st_size,
        state=state,
        status="" if status == BREAKING_OFF else status,
        metrics={visible(name, LONGEST_NAME): _number(metrics[name]) for name in list(metrics)[:MOST_METRICS]},
        changes=_texts(notes.get("changes"), LONGEST_CHANGE, MOST_CHANGES),
        note=visible(notes.get("note", ""), LONGEST_NOTE),
        tags=_texts(notes.get("tags"), LONGEST_TAGS, LONGEST_TAGS),
        kept=bool(notes.get("keep", False)),
        owner=owner,
        visitor=visitor,
        lessons=_lessons(notes.get("lessons")),
        own_metrics=_texts(notes.get("own_metrics"), LONGEST_NAME, MOST_METRICS),
        why_stopped=visible(notes.get("why_stopped", ""), LONGEST_CHANGE),
        breaks_off=visible(notes.get(BREAKS_OFF, ""), LONGEST_CHANGE),
        gaps=_gaps(notes),
        problem=problem,
    )


def _time(value: Any) -> datetime | None:
    """Local time from the notes, from a file's name or from its date in s; None for anything else."""
    for read in (datetime.fromisoformat, lambda words: datetime.strptime(words, TIME_FORMAT), datetime.fromtimestamp):
        with contextlib.suppress(ValueError, TypeError, OverflowError, OSError):
            return read(value).replace(tzinfo=None)
    return None


def _number(value: Any) -> float | None:
    """A finite number from the notes; None for anything else."""
    try:
        number = float(value) if isinstance(value, (int, float)) else math.nan
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def _gaps(notes: dict[str, Any]) -> str:
    rows, dropped = (_number(notes.get(name)) or 0.0 for name in ("rows", "dropped"))
    if not (rows > 0 and dropped > 0):
        return ""
    share = number_text(max(100 * dropped / (rows + dropped), LEAST_SHARE), 2)
    return f"{share} % of the samples are missing, as the computer was too busy: curves and metrics leave them out."


def _lessons(values: Any) -> tuple[LessonProgress, ...]:
    found: list[LessonProgress] = []
    for value in values[:MOST_LESSONS] if isinstance(values, list) else ():
        if isinstance(value, dict):
            names = ("lesson", "question", "answer", "guess", "passed")
            texts = {name: visible(value.get(name, ""), LONGEST_CHANGE) for name in names}
            options = _texts(value.get("options"), LONGEST_CHANGE, MOST_LESSONS)
            found.append(LessonProgress(step=int(_number(value.get("step")) or 1), options=options, **texts))
    return tuple(found)


def _texts(values: Any, longest: int, most: int) -> tuple[str, ...]:
    return tuple(visible(value, longest) for value in values[:most]) if isinstance(values, list) else ()


def state_word(row: RunRow) -> str:
    """The state in a word for people."""
    if row.state == "in use":
        return "recording"
    if row.breaks_off and row.state == "recovered":
        return "breaks off"
    if row.state == "complete":
        return "measured" if row.is_measured else "stopped" if row.is_stopped else "complete"
    return row.state


def size_text(size: float) -> str:
    """A size, bytes, as a text with a suitable unit."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 999.5:  # What is shown as 1000 is one of the next unit.
            return f"{number_text(size, 3)} {unit}"
        size /= 1000
    return f"{number_text(size, 3)} TB"


def duration_text(duration: float | None) -> str:
    """A simulated time, s, as a text for people."""
    if duration is None:
        return "–"
    if duration < 120:
        return f"{number_text(duration)} s"
    minutes, seconds = divmod(round(duration), 60)
    return f"{minutes} min {seconds:02d} s"


def told_apart(rows: Sequence[RunRow], logs: Path) -> list[RunRow]:
    """Runs with their visitors' names told apart from all other names in the notes of a folder."""
    if not any(row.visitor and row.owner for row in rows):
        return list(rows)
    names = names_told_apart(((row.visitor, row.owner) for row in rows), logs)
    return [replace(row, visitor=names[row.visitor, row.owner]) for row in rows]
