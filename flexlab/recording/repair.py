"""Torn recordings: finished after their writer has closed them or died, and read up to the tear, from a mended copy.

Rerun's own tool adds footer and index and cuts off a torn tail, in a process of its own. A finished file opens faster; a file
whose last message is torn is refused by every reader.
"""

import contextlib
import errno
import os
import queue
import shutil
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from flexlab.errors import RecordingError
from flexlab.files import remove_left_drafts, replacing
from flexlab.recording.rerun_internals.chunks import (
    PROPERTIES,
    Row,
    Unreadable,
    entity_times,
    stream_rows,
)
from flexlab.recording.rerun_internals.rrd_file import check_path, has_footer
from flexlab.recording.rerun_internals.tool import Mending, crashes_readers
from flexlab.recording.store.notes import SOUND, read_notes, write_notes
from flexlab.recording.store.run_files import BREAKING_OFF, check_recording, claim, list_runs, run_state

BEGIN, SAMPLES, END = PROPERTIES + "run", "/exact/samples", PROPERTIES + "end"
"""Entities of a run's scenario, of its samples, and of how it ended."""
GROWTH = 1.3
"""Free space needed for the finished file, in sizes of the unfinished one."""


def finish(path: Path, mending: Mending | None = None, join: bool = True) -> None:
    """Give a recording its footer and index, in place; `join` also joins small pieces. The file keeps its date.

    Does nothing if it has a footer, or if it is being written. Raises `RecordingError` if it cannot be read.
    """
    mending = mending or Mending()
    check_path(path)
    try:
        if has_footer(path):
            return
        if path.stat().st_size == 0:
            raise RecordingError(f"{path} is empty: its run was lost before anything was written.")
        own = claim(path, "rb+")
    except BlockingIOError:
        return
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror}): check its name and permissions.") from None
    try:
        _finish_claimed(path, mending, join)
    finally:
        own.release()


def _finish_claimed(path: Path, mending: Mending, join: bool) -> None:
    before = path.stat()
    if shutil.disk_usage(path.parent).free < GROWTH * before.st_size:
        # A lab that is recording there must not run into a full disk.
        raise _not_now(path, os.strerror(errno.ENOSPC))
    ended = read_notes(path).get("ended", False)
    try:
        with replacing(path) as draft:
            is_there = mending.rewrite(path, draft, join) and _has_rows(draft, BEGIN)
            ends = is_there and _has_rows(draft, END)
            if not is_there or not (ends or _has_rows(draft, SAMPLES)):
                raise RecordingError(f"{path.name} is damaged beyond repair: nothing of its run can be read.")
            os.utime(draft, ns=(before.st_atime_ns, before.st_mtime_ns))
        if not (ended and ends):
            # A copy that broke off has the notes on the whole run.
            cut = {"status": BREAKING_OFF, "metrics": {}, "duration": None} if ended else {}
            write_notes(path, recovered=True, **cut)
    except RecordingError:
        if not mending.stopped:
            with contextlib.suppress(OSError):
                write_notes(path, damaged_size=before.st_size)
        raise
    except OSError as error:
        raise _not_now(path, error.strerror) from None


def _has_rows(path: Path, entity: str) -> bool:
    """Whether anything of an entity can be read from a whole file."""
    with contextlib.suppress(Unreadable):
        return any(True for _ in stream_rows(path, [entity]))
    return False


def _not_now(path: Path, reason: str) -> RecordingError:
    return RecordingError(
        f"{path} cannot be mended ({reason}): make room or correct its permissions. Nothing of it is lost."
    )


def sweep_empty(logs: Path) -> int:
    """Remove the empty files of labs that died as they made them, and return their number. Files in use stay."""
    count = 0
    for path in list_runs(logs):
        with contextlib.suppress(OSError):
            if path.stat().st_size or read_notes(path):
                continue
            file = claim(path, "rb+")
            try:
                # Checked again under the claim: its writer may just have begun.
                if file.in_place and path.stat().st_size == 0:
                    path.unlink()
                    count += 1
            finally:
                file.release()
    return count


def _finish_if_possible(path: Path, mending: Mending) -> None:
    with contextlib.suppress(RecordingError, OSError):
        if not mending.stopped:
            finish(path, mending)


def finish_abandoned(logs: Path, mending: Mending | None = None) -> None:
    """Finish the files that dead writers left in the folder, and remove their empty ones and drafts.

    A file that cannot be finished stays as it is, and `run_state` says so.
    """
    mending = mending or Mending()
    with contextlib.suppress(OSError):
        sweep_empty(logs)
        remove_left_drafts(logs)
        for path in unfinished_runs(logs):
            _finish_if_possible(path, mending)


def unfinished_runs(logs: Path) -> list[Path]:
    """Recordings without a footer, newest first, without those in use and those known as damaged."""
    return [path for path in list_runs(logs) if run_state(path) == "unfinished"]


class Finisher:
    """Finishes files as they are added, after those that an earlier lab left in `logs`."""

    def __init__(self, logs: Path):
        self._queue: queue.SimpleQueue[Path | None] = queue.SimpleQueue()
        self._mending = Mending()
        self._thread = threading.Thread(target=self._work, args=(logs,), name="finisher", daemon=True)
        self._thread.start()

    def add(self, path: Path) -> None:
        """Finish this file soon."""
        self._queue.put(path)

    def close(self, patience: float) -> None:
        """Stop when all is done, or after `patience` s; the next start does the rest."""
        self._queue.put(None)
        self._thread.join(patience)
        self._mending.stop()
        self._thread.join()

    def _work(self, logs: Path) -> None:
        finish_abandoned(logs, self._mending)
        while (path := self._queue.get()) is not None:
            _finish_if_possible(path, self._mending)
            if run_state(path) == "complete":
                note_sound(path)


def check_foreign(path: Path) -> None:
    """Raise `RecordingError` for a recording on which rerun's reader would crash, and this process with it."""
    check_recording(path)
    check_path(path)
    notes, found = read_notes(path), _identity(path)
    if notes.get(SOUND) == found:
        return
    if crashes_readers(path):
        raise RecordingError(f"{path} is damaged beyond repair: nothing of its run can be read.")
    if "status" in notes:  # Else they are not flexlab's, or its run is being recorded.
        with contextlib.suppress(OSError):
            write_notes(path, **{SOUND: found})


def note_sound(path: Path) -> None:
    """Note that readers do not crash on a recording, which this process has just written."""
    with contextlib.suppress(OSError, RecordingError):
        write_notes(path, **{SOUND: _identity(path)})


def _identity(path: Path) -> list[int]:
    """What changes when a file is written, replaced or copied. Raises `RecordingError` if it is gone."""
    try:
        found = path.stat()
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror}): check its name and permissions.") from None
    return [found.st_size, found.st_mtime_ns, found.st_ino]


Rows = dict[str, list[Row]]
"""Entity → its rows in the order of time."""


def read_rows(path: Path, content: list[str]) -> Rows:
    """The rows of the entities that match, from a mended copy if the file is torn. Raises `RecordingError`."""
    check_recording(path)
    try:
        return _rows_by_entity(path, content)
    except Unreadable:
        with _mended(path) as copy:
            return _rows_by_entity(copy, content)


def rows_in_order(path: Path, entity: str) -> Iterator[Row]:
    """The rows of one entity in the order of time, few of them in memory at once.

    A file that is torn, or to which a piece is just being written, is read from a mended copy. Raises `RecordingError`.
    """
    check_recording(path)
    given = 0
    try:
        for row in _in_order(path, entity):
            yield row
            given += 1
    except Unreadable:
        with _mended(path) as copy:
            yield from islice(_in_order(copy, entity), given, None)


def _in_order(path: Path, entity: str) -> Iterator[Row]:
    # An indexed file may hold rows out of order: early ones wait.
    turns = np.argsort(np.argsort(entity_times(path, entity), kind="stable"), kind="stable")
    waiting: dict[int, Row] = {}
    following = 0
    # A run that is being recorded has grown meanwhile: later rows are left out.
    for turn, (_, row) in zip(turns.tolist(), stream_rows(path, [entity]), strict=False):
        waiting[turn] = row
        while following in waiting:
            yield waiting.pop(following)
            following += 1


@contextmanager
def _mended(path: Path) -> Iterator[Path]:
    """A whole copy of the file up to the tear. Raises `RecordingError` if nothing of the run can be read."""
    with ExitStack() as closing:
        try:
            folder = closing.enter_context(TemporaryDirectory(prefix="flexlab-"))
            copy = Path(folder) / path.name
            found = Mending().rewrite(path, copy)
        except OSError as error:
            raise RecordingError(
                f"{path} is torn, and a mended copy of it cannot be put among the temporary files ({error.strerror}): "
                "make room there, or set TMPDIR to another folder."
            ) from None
        try:
            if found:
                yield copy
                return
        except Unreadable:
            pass
    raise RecordingError(f"{path} is damaged beyond repair: nothing of its run can be read.")


def _rows_by_entity(path: Path, content: list[str]) -> Rows:
    rows: Rows = {}
    for entity, row in stream_rows(path, content):
        rows.setdefault(entity, []).append(row)
    for entity in rows.values():
        entity.sort(key=lambda row: row[0])
    return rows
