"""A rerun file as plain rows: entity, time, values. Torn files are read up to the tear."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.chunk_reader import Row, Unreadable, entity_times, stream_rows
from flexlab.recording.rerun_internals.tool import Mending
from flexlab.recording.store.run_files import check_recording

Rows = dict[str, list[Row]]
"""Entity → its rows in the order of times."""


def read_rows(path: Path, content: list[str]) -> Rows:
    """The rows of the entities that match; of a torn file through a mended copy. Raises `RecordingError`."""
    check_recording(path)
    try:
        return _rows_by_entity(path, content)
    except Unreadable:
        with _mended(path) as copy:
            return _rows_by_entity(copy, content)


def rows_in_order(path: Path, entity: str) -> Iterator[Row]:
    """The rows of one entity in the order of times, few of them in memory at once.

    Of a torn file through a mended copy. Raises `RecordingError`.
    """
    check_recording(path)
    with ExitStack() as closing:
        try:
            times = entity_times(path, entity)
        except Unreadable:
            path = closing.enter_context(_mended(path))
            times = entity_times(path, entity)
        # A file that was indexed may hold some rows before their turn: those wait.
        turns = np.argsort(np.argsort(times, kind="stable"), kind="stable")
        waiting: dict[int, Row] = {}
        following = 0
        try:
            # A run that is being recorded has grown meanwhile: what came later is left out.
            for turn, (_, row) in zip(turns.tolist(), stream_rows(path, [entity]), strict=False):
                waiting[turn] = row
                while following in waiting:
                    yield waiting.pop(following)
                    following += 1
        except Unreadable:
            raise RecordingError(f"{path} changed while it was read: try again.") from None


@contextmanager
def _mended(path: Path) -> Iterator[Path]:
    """A copy up to the tear. Raises `RecordingError` if nothing of the run can be read."""
    with TemporaryDirectory(prefix="flexlab-") as folder:
        copy = Path(folder) / path.name
        try:
            found = Mending().rewrite(path, copy)
        except OSError as error:
            raise RecordingError(
                f"{path} has no end, and a mended copy of it cannot be put into {folder} ({error.strerror}): make room."
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
