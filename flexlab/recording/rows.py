"""The rows of a recording's entities, from a mended copy if the file is torn."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.chunks import Row, Unreadable, entity_times, stream_rows
from flexlab.recording.rerun_internals.tool import Mending
from flexlab.recording.store.run_files import check_recording

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
