"""Reads a rerun file chunk by chunk, as plain rows. `rerun.chunk` is what is left of reading in the base wheel."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import LazyChunkStream, RrdReader

from flexlab.recording.rerun_internals.columns import TIMELINE

ROW_ID = "rerun.controls.RowId"
"""Rerun's own column, of no interest here."""

Row = tuple[int, dict[str, Any]]
"""(time in ns, component → value); what has no time stands at -1."""


class Unreadable(Exception):
    """Rerun refuses the file."""


def entity_times(path: Path, entity: str) -> np.ndarray:
    """Times in ns of an entity's rows as they stand in the file."""
    times = [np.asarray(_instants(batch)) for _, batch in _batches(path, [entity])]
    return np.concatenate([np.empty(0, np.int64), *times])


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


def has_recording(path: Path) -> bool:
    """Whether rerun finds a recording in the file, not only a frame around nothing."""
    try:
        with quiet_reader(path) as reader:
            return bool(reader.recordings())
    except (ValueError, RuntimeError, OSError):
        return False
