"""Rerun's streams and files: columns to write, and chunks to read.

Columns are built from whole NumPy blocks, ten times faster than rerun's archetypes. `rerun.chunk` is the only reader in the
base wheel.
"""

import os
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import LazyChunkStream, RrdReader
from rerun_bindings import flush_and_cleanup_orphaned_recordings

from flexlab.errors import RecordingError
from flexlab.recording.rerun_internals.rrd_file import check_path
from flexlab.text import visible

TIMELINE = "sim_time"
"""The one timeline of a recording: simulation time. Wall clocks may jump, so none is recorded as an axis."""
PROPERTIES = "/__properties/"
"""Entity under which rerun keeps a recording's properties."""
NANOSECONDS = 1_000_000_000
"""Nanoseconds per second, the resolution of rerun's timelines."""

if hasattr(os, "register_at_fork"):
    # A forked process, as of Python's `multiprocessing`, cannot end what its parent has abandoned, and would record nothing.
    os.register_at_fork(before=flush_and_cleanup_orphaned_recordings)


def new_stream(application: str, run_id: str | None = None) -> rr.RecordingStream:
    """A stream without rerun's own properties; `application`: the name for which a person's changes to a layout hold.

    Raises `RecordingError` if the environment switches rerun off.
    """
    # As `rerun.init` does: an abandoned stream keeps two threads and a megabyte.
    with suppress(RuntimeError):  # In a forked process that has dropped a stream of its parent.
        flush_and_cleanup_orphaned_recordings()
    stream = rr.RecordingStream(application, recording_id=run_id, send_properties=False)
    if not rr.is_enabled(stream):
        setting = visible(os.environ.get("RERUN", ""))
        raise RecordingError(f"Rerun records nothing while RERUN = {setting} is in the environment: unset it.")
    # Wall-clock axes would only be a second, jumpy time beside the simulation's own.
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    return stream


class _Layout:
    """A layout that keeps the streams by which rerun sends it."""

    def __init__(self, layout: rrb.Blueprint):
        self._layout, self.streams = layout, list[rr.RecordingStream]()

    def to_blueprint(self) -> "_Layout":
        return self

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self.streams.append(stream)
        self._layout._log_to_stream(stream)


def send_layout(stream: rr.RecordingStream, layout: rrb.Blueprint) -> None:
    """Send a layout, to be shown at once."""
    sent: Any = _Layout(layout)
    stream.send_blueprint(sent, make_active=True, make_default=True)
    for each in sent.streams:  # A connected stream would hold itself, and never end.
        each.disconnect()


class Column:
    """One component of one entity over many instants, as `RecordingStream.send_columns` wants it."""

    def __init__(self, archetype: str, component: str, component_type: str | None, values: pa.Array):
        self._descriptor = rr.ComponentDescriptor(
            f"{archetype}:{component}",
            archetype=archetype if "." in archetype else f"rerun.archetypes.{archetype}",
            component_type=component_type and f"rerun.components.{component_type}",
        )
        self._values = values

    def component_descriptor(self) -> rr.ComponentDescriptor:
        """Name and type of the component."""
        return self._descriptor

    def as_arrow_array(self) -> pa.Array:
        """One list of values per instant."""
        return self._values


def time_column(time: np.ndarray) -> rr.TimeColumn:
    """The instants `time` (N,), s, for `send_columns`."""
    # Rerun would truncate times instead of rounding them: 0.003 s would become 2999999 ns.
    return rr.TimeColumn(TIMELINE, duration=np.rint(np.asarray(time) * NANOSECONDS).astype("timedelta64[ns]"))


def send_columns(stream: rr.RecordingStream, entity: str, times: rr.TimeColumn, columns: Iterable[Column]) -> None:
    """Send columns at the instants of `times`."""
    # A `Column` has all that rerun needs of a `ComponentColumn`, without being one by name.
    stream.send_columns(entity, [times], cast(Iterable[rr.ComponentColumn], columns))


def scalars(values: np.ndarray) -> Column:
    """Plotted signals (N, k), in single precision, which is enough for any screen; exact samples are in blocks (`codec`).

    Rerun's scalars have double precision, but rerun plots any number without a component type: hence none here.
    """
    return Column("Scalars", "scalars", None, _lists(pa.array(_flat(values)), values.shape[1]))


def vectors(archetype: str, component: str, component_type: str, values: np.ndarray) -> Column:
    """k vectors of width d per instant, (N, k, d)."""
    return Column(archetype, component, component_type, _lists(_tuples(values), values.shape[1]))


def line_strips(values: np.ndarray) -> Column:
    """k line strips of m points in space per instant, (N, k, m, 3)."""
    strips = _lists(_tuples(values), values.shape[2], nullable=False)
    return Column("LineStrips3D", "strips", "LineStrip3D", _lists(strips, values.shape[1]))


def single(archetype: str, component: str, component_type: str | None, value: str | bytes) -> Column:
    """One text, or one string of bytes, for one instant."""
    return Column(archetype, component, component_type, _lists(pa.array([value]), 1))


def _flat(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values, np.float32).ravel()


def _tuples(values: np.ndarray) -> pa.Array:
    item = pa.field("item", pa.float32(), nullable=False)
    return pa.FixedSizeListArray.from_arrays(pa.array(_flat(values)), type=pa.list_(item, values.shape[-1]))


def _lists(items: pa.Array, width: int, nullable: bool = True) -> pa.Array:
    """Lists of `width` items each, of the type of rerun's own: it draws nothing of another type."""
    kind = pa.list_(pa.field("item", items.type, nullable=nullable))
    return pa.ListArray.from_arrays(_offsets(len(items) // width if width else 0, width), items, type=kind)


@lru_cache(maxsize=32)
def _offsets(count: int, width: int) -> pa.Array:
    return pa.array(np.arange(count + 1, dtype=np.int32) * width)


ROW_ID = "rerun.controls.RowId"
"""Rerun's own column, of no interest here."""
Row = tuple[int, dict[str, Any]]
"""(time in ns, component → value); the time of static data is -1."""


class Unreadable(Exception):
    """Rerun refuses the file."""


def entity_times(path: Path, entity: str) -> np.ndarray:
    """Times of an entity's rows, ns, in the order of the file."""
    times = [np.asarray(_instants(batch)) for _, batch in _batches(path, [entity])]
    return np.concatenate([np.empty(0, np.int64), *times])


def stream_rows(path: Path, content: list[str]) -> Iterator[tuple[str, Row]]:
    """(entity, row) in the order of the file, with one piece of it in memory at a time. Raises `Unreadable`."""
    for entity, batch in _batches(path, content):
        for row in _rows(batch):
            yield entity, row


def _batches(path: Path, content: list[str]) -> Iterator[tuple[str, pa.RecordBatch]]:
    """(entity, some of its rows) in the order of the file. Raises `Unreadable`, `RecordingError` for several recordings."""
    try:
        with quiet_reader(path) as reader:
            if (count := len(reader.recordings())) > 1:
                raise RecordingError(
                    f"{path} holds {count} recordings, as `rerun rrd merge` joins them: choose those that it was made from."
                )
            if not count:
                raise Unreadable
            chunks = _stream(reader).filter(content=content)
        for chunk in chunks:
            yield chunk.entity_path, chunk.to_record_batch()
    except (ValueError, RuntimeError, OSError) as error:
        raise Unreadable from error


@contextmanager
def quiet_reader(path: Path) -> Iterator[RrdReader]:
    """Rerun's reader of a file, without its warning that the file has no index yet. Raises `RecordingError` as `check_path`."""
    check_path(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield RrdReader(path)


def _stream(reader: RrdReader) -> LazyChunkStream:
    """All chunks; read by the index if the file has one, so that a filter leaves the others on the disk."""
    try:
        return reader.store().stream()
    except (ValueError, RuntimeError):
        return reader.stream()


def _rows(batch: pa.RecordBatch) -> Iterator[Row]:
    """Each row with the first value of every component."""
    components = [field.name for field in batch.schema if field.name != ROW_ID and _is_plain(field.type)]
    columns = {name.rpartition(":")[2]: batch.column(name).to_pylist() for name in components}
    for row, instant in enumerate(_instants(batch)):
        lists = {name: column[row] for name, column in columns.items() if isinstance(column[row], list)}
        yield instant, {name: values[0] for name, values in lists.items() if values}


def _is_plain(kind: pa.DataType) -> bool:
    """Whether a column has lists of numbers or texts, as flexlab's have; a dictionary would unpack to any size."""
    is_text = (pa.types.is_string, pa.types.is_large_string, pa.types.is_binary, pa.types.is_large_binary)
    return pa.types.is_list(kind) and any(test(kind.value_type) for test in (pa.types.is_primitive, *is_text))


def _instants(batch: pa.RecordBatch) -> list[int]:
    """Time of each row, ns; -1 for static data."""
    if TIMELINE not in batch.schema.names:
        return [-1] * batch.num_rows
    return batch.column(TIMELINE).view(pa.int64()).to_pylist()
