"""A rerun file as plain rows: entity, time, values. Torn files are read up to the tear."""

import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import LazyChunkStream, RrdReader

from flexlab.errors import RecordingError
from flexlab.recording.chunks import TIMELINE
from flexlab.recording.repair import Mending
from flexlab.recording.store.run_files import check_recording

ROW_ID = "rerun.controls.RowId"
"""Rerun's own column, of no interest here."""

Row = tuple[int, dict[str, Any]]
"""(time in ns, component → value); what has no time stands at -1."""

Rows = dict[str, list[Row]]
"""Entity → its rows in the order of times."""


class Unreadable(Exception):
    """Rerun refuses the file."""


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
            times = _times(path, entity)
        except Unreadable:
            path = closing.enter_context(_mended(path))
            times = _times(path, entity)
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


def _times(path: Path, entity: str) -> np.ndarray:
    """Times in ns of an entity's rows as they stand in the file."""
    times = [np.asarray(_instants(batch)) for _, batch in _batches(path, [entity])]
    return np.concatenate([np.empty(0, np.int64), *times])


def _rows_by_entity(path: Path, content: list[str]) -> Rows:
    rows: Rows = {}
    for entity, row in stream_rows(path, content):
        rows.setdefault(entity, []).append(row)
    for entity in rows.values():
        entity.sort(key=lambda row: row[0])
    return rows


def stream_rows(path: Path, content: list[str]) -> Iterator[tuple[str, Row]]:
    """(entity, row) as they stand in the file, one piece of it in memory at a time. Raises `Unreadable`."""
    for entity, batch in _batches(path, content):
        for row in _rows(batch):
            yield entity, row


def _batches(path: Path, content: list[str]) -> Iterator[tuple[str, pa.RecordBatch]]:
    """(entity, some of its rows) as they stand in the file. Raises `Unreadable`."""
    try:
        with quiet_reader(path) as reader:
            if not reader.recordings():
                raise Unreadable
            chunks = _stream(reader).filter(content=content)
        for chunk in chunks:
            yield chunk.entity_path, chunk.to_record_batch()
    except (ValueError, RuntimeError, OSError) as error:
        raise Unreadable from error


@contextmanager
def quiet_reader(path: Path) -> Iterator[RrdReader]:
    """Rerun's reader of a file, whose warnings are kept back: that a file has no index yet is no news here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield RrdReader(path)


def _stream(reader: RrdReader) -> LazyChunkStream:
    """All chunks; by the index, if the file has one, so that a filter leaves the others on the disk."""
    try:
        return reader.store().stream()
    except (ValueError, RuntimeError):
        return reader.stream()


def _rows(batch: pa.RecordBatch) -> Iterator[Row]:
    """Each row with the first value of every component."""
    components = [name for name in batch.schema.names if name not in (TIMELINE, ROW_ID)]
    columns = {name.rpartition(":")[2]: batch.column(name).to_pylist() for name in components}
    for row, instant in enumerate(_instants(batch)):
        yield instant, {name: column[row][0] for name, column in columns.items() if column[row]}


def _instants(batch: pa.RecordBatch) -> list[int]:
    """Time of each row in ns; -1 for what has none."""
    if TIMELINE not in batch.schema.names:
        return [-1] * batch.num_rows
    return batch.column(TIMELINE).cast(pa.int64()).to_pylist()
