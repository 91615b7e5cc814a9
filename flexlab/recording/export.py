"""Runs as CSV, Parquet, NPZ or an xarray dataset for other programs, and back, bit for bit.

All values are in SI units, which the columns' names give. Scenario, versions, seed, start and events (with the commands) are
included as one JSON text: in CSV the first line (after "# "), in Parquet and NPZ the metadata named "flexlab". A dataset has
named axes, units and meanings.
"""

import csv
import io
import json
import math
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import ZipFile

import numpy as np
import pyarrow as pa
import pyarrow.csv as arrow_csv
import pyarrow.parquet as parquet
from numpy.lib.format import read_array

from flexlab import __version__
from flexlab.errors import RecordingError, StudyError
from flexlab.files import check_ordinary, packed_sizes, read_packed, unique_fields, writing
from flexlab.machine import free_memory
from flexlab.presets import scenario_text
from flexlab.recording.codec import event_from_values, event_values, larger_blocks, state_values
from flexlab.recording.reader import Recording, within
from flexlab.recording.store.formats import FORMAT, Changes, checked_format, migrate
from flexlab.recording.store.run_index import size_text
from flexlab.recording.table_columns import (
    Column,
    axis_labels,
    check_events,
    check_times,
    from_columns,
    table_columns,
    to_columns,
)
from flexlab.scenario import Scenario, parse_scenario
from flexlab.signal import ARM, AXIS, COORDINATE, JOINT, Signal
from flexlab.sim.samples import Run, Samples, Status
from flexlab.sim.signals import TABLE, own_signals
from flexlab.text import counted, visible, writable

if TYPE_CHECKING:
    import xarray


NAMES = {ARM: "arm", AXIS: "axis", JOINT: "joint", COORDINATE: "coordinate"}
"""Names of axes that several signals share; any other axis is named after its signal."""


def to_dataset(run: Run) -> "xarray.Dataset":
    """All signals over time, with labels along their axes. Raises `StudyError` if xarray is not installed."""
    try:
        import xarray
    except ImportError:
        raise StudyError("xarray is not installed: pip install 'flexlab[xarray]' brings it.") from None
    signals = dict(TABLE) | {signal.name: signal for signal in own_signals(run.scenario)}
    arrays = {name: array for name, array in run.signals().items() if name in signals}
    found = {name: _variable(signals[name], array, run.scenario) for name, array in arrays.items()}
    about = {
        "scenario": scenario_text(run.scenario),
        "status": str(run.status),
        "status_text": run.status.text,
        "source": f"flexlab {__version__}",
    }
    return xarray.Dataset(
        {name: variable for name, (variable, _) in found.items()},
        {name: names for _, labels in found.values() for name, names in labels.items()},
        about,
    )


def _variable(signal: Signal, array: np.ndarray, scenario: Scenario) -> tuple[tuple, dict[str, list[str]]]:
    """(dimensions, numbers, attributes) of a signal, and the labels along its dimensions."""
    names, labels = ["time"], {}
    for place, axis in enumerate(signal.axes, 1):
        known = ["_".join(words) for words, _ in axis_labels(axis, scenario)]
        # If a command has changed the mesh during the run, coordinates have no unique labels.
        fits = len(known) == array.shape[place]
        shared = NAMES.get(axis) if fits else None
        names.append(shared or f"{signal.name}_{NAMES.get(axis, 'entry')}")
        if shared:
            labels[shared] = known
    about = {"long_name": signal.meaning, "symbol": signal.symbol, "units": signal.unit_text}
    return (tuple(names), array, about | ({"source": signal.equation} if signal.equation else {})), labels


NAME = "flexlab"  # of the metadata
BATCH_ROWS = 20_000
"""Samples written at once: a long table then needs little memory, and small pieces pack badly."""
LONGEST_REASON = 200
"""Largest length of a reader's error that is passed on, characters."""
Columns = dict[str, np.ndarray]


def export_recording(recording: Recording, path: Path, start: float | None = None, end: float | None = None) -> Path:
    """Write a recording to `path` (.csv, .parquet or .npz), from `start` to `end` s of simulation time.

    Raises `RecordingError` for another suffix, an empty range or a file that cannot be written.
    """
    write, _ = _format(path)
    scenario, status = recording.scenario, recording.status
    metadata = {
        "seed": scenario.controller.sensor_noise.seed,
        **recording.properties,
        "preset": recording.name,
        "started": recording.started.isoformat(),
        "start": None if recording.start is None else state_values(recording.start),
        "events": [event_values(event) for event in recording.events],
        "format": FORMAT,
        "computed_in": recording.computed_in,
        "status": [str(status), status.text, status.time],
        "scenario": scenario.model_dump(mode="json"),
    }
    pieces = larger_blocks(within(recording.blocks(), start, end), BATCH_ROWS)
    later = Changes(scenario, recording.events).scenarios
    with writing(path, "choose another place", RecordingError) as draft:
        write(draft, _batches(pieces, scenario, later), json.dumps(metadata, ensure_ascii=False))
    return path


def _batches(pieces: Iterable[Samples], scenario: Scenario, later: Iterable[Scenario]) -> Iterator[Columns]:
    """The columns of each piece: the same for all, without signals that were not recorded."""
    columns: list[Column] = []
    for piece in pieces:
        columns = columns or [c for c in table_columns(scenario, later) if c.signal not in piece.absent]
        yield to_columns(piece, columns)


def import_run(path: Path) -> tuple[Run, dict[str, Any]]:
    """(run, metadata) of an exported file; the metadata's "left_out" names columns that are not signals.

    Raises `RecordingError` for any other file.
    """
    _, read = _format(path)
    try:
        check_ordinary(path)
        columns, text = read(path)
        metadata = writable(json.loads(text, object_pairs_hook=unique_fields))
        scenario = parse_scenario(metadata["scenario"])
        samples, left_out = from_columns(columns, scenario)
        check_times(path.name, samples.time)
        events = [event_from_values(event) for event in metadata.get("events", ())]
        check_events(path.name, events)
        samples = migrate(samples, checked_format(metadata.get("format", 1)), lambda: Changes(scenario, events))
        name, sentence, time = metadata["status"]
        status = Status(str(name), str(sentence), float(time))
        if not math.isfinite(status.time):
            raise ValueError(f"its end, {status.time} s, is not finite")
    except RecordingError:
        raise
    except FileNotFoundError:
        raise RecordingError(f"There is no file {path}: check the name.") from None
    except Exception as error:
        # Archives fail in a dozen ways: locked, torn, packed unusually, too large by their own account.
        raise RecordingError(f"{path} is not a run exported by flexlab ({reason_of(error)}).") from None
    return Run(**samples.signals(), scenario=scenario, status=status), metadata | {"left_out": left_out}


_REASONS: tuple[tuple[type[Exception], str], ...] = (
    (json.JSONDecodeError, "its metadata are not JSON"),
    (KeyError, "its metadata are missing or not complete"),
    (StopIteration, "it has no columns"),
    (UnicodeDecodeError, "it is not text in UTF-8"),
    (RecursionError, "its metadata are nested too deeply"),
    (TypeError, "its metadata have another form"),
    (AttributeError, "its metadata have another form"),
)
"""Reasons for errors whose own words mean nothing to a reader of the file."""


def reason_of(error: Exception) -> str:
    """Why a table cannot be imported, in words that mean something to a reader of the file."""
    known = next((reason for kind, reason in _REASONS if isinstance(error, kind)), "")
    said = getattr(error, "strerror", None) or visible(str(error).split("\n")[0], LONGEST_REASON)
    said = said.partition("; use `usecols`")[0]  # Advice for callers of NumPy.
    # NumPy's error advises loading Python objects, which would run code from the archive.
    return known or ("it holds Python objects" if "pickle" in said else said) or type(error).__name__


SAVED_ANEW = "a spreadsheet has saved it in a form of its own: import the file that was exported"
"""Spreadsheets quote the metadata, separate by semicolons where commas begin decimals, and round."""


def _check_room(size: int) -> None:
    """Raise ValueError for a table of `size` bytes in all that does not fit into the memory: archives pack a thousandfold."""
    free = free_memory()
    if free is not None and size > free:
        raise ValueError(f"it unpacks to {size_text(size)}, and {size_text(free)} of memory are free")


def _write_csv(path: Path, batches: Iterable[Columns], metadata: str) -> None:
    # Arrow writes the shortest number that reads back to the same bits.
    options = arrow_csv.WriteOptions(include_header=False)
    with path.open("wb") as file:
        file.write(f"# {metadata}\n".encode())
        for number, columns in enumerate(batches):
            if number == 0:
                heads = io.StringIO(newline="")
                csv.writer(heads, lineterminator="\n").writerow(columns)  # A law's units may have commas.
                file.write(heads.getvalue().encode())
            arrow_csv.write_csv(pa.table(columns), file, options)


def _read_csv(path: Path) -> tuple[Columns, str]:
    with path.open(encoding="utf-8-sig", newline="") as file:
        metadata = file.readline().removeprefix("# ")
        if metadata.startswith('"# {'):
            raise ValueError(SAVED_ANEW)
        if not metadata.startswith("{"):
            raise ValueError("its first line has no metadata")
        names = next(csv.reader(file))
        if len(names) == 1 and ";" in names[0]:
            raise ValueError(SAVED_ANEW)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # A table without rows needs no warning.
            table = np.loadtxt(file, delimiter=",", ndmin=2)
    if table.size and table.shape[1] != len(names):
        raise ValueError(f"its rows have {counted(table.shape[1], 'value')}, and its head {len(names)}")
    table = table.reshape(-1, len(names))
    return unique_fields(list(zip(names, table.T, strict=True))), metadata


def _write_parquet(path: Path, batches: Iterable[Columns], metadata: str) -> None:
    with ExitStack() as closing:
        # Opened first, so that an unwritable place is reported before hours of data are read.
        file = closing.enter_context(path.open("wb"))
        writer = None
        for columns in batches:
            table = pa.table(columns).replace_schema_metadata({NAME: metadata})
            if writer is None:
                # Splitting doubles into their bytes packs smooth signals a third smaller.
                packing: Any = {"compression": "zstd", "use_dictionary": False, "use_byte_stream_split": True}
                writing = parquet.ParquetWriter(file, table.schema, write_page_checksum=True, **packing)
                writer = closing.enter_context(writing)
            writer.write_table(table)


def _read_parquet(path: Path) -> tuple[Columns, str]:
    with parquet.ParquetFile(path, page_checksum_verification=True) as file:
        _check_room(file.metadata.num_rows * file.metadata.num_columns * np.dtype(float).itemsize)
        # Texts are left out unread: a dictionary makes gigabytes of a megabyte, which no declared size tells.
        plain = unique_fields([(field.name, _is_plain(field.type)) for field in file.schema_arrow])
        for name in (name for name in plain if not plain[name]):
            # The reader takes "a.b" for a part of "a", and would read both.
            if any(plain.get(whole) for whole in accumulate(name.split("."), "{}.{}".format)):
                raise ValueError(f"the name of its column {name:.40} begins like another one's: give it no dot")
        table = file.read([name for name in plain if plain[name]])
        rows, metadata = file.metadata.num_rows, file.schema_arrow.metadata or {}
    columns = {name: table[name].to_numpy() if plain[name] else np.zeros(rows, "S1") for name in plain}
    return columns, metadata[NAME.encode()].decode()


def _is_plain(kind: pa.DataType) -> bool:
    """Whether Arrow's type has one small value per row."""
    return pa.types.is_primitive(kind) or pa.types.is_decimal(kind) or pa.types.is_null(kind)


def _write_npz(path: Path, batches: Iterable[Columns], metadata: str) -> None:
    with path.open("wb") as file:
        parts = list(batches)
        arrays: dict[str, Any] = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        np.savez_compressed(file, **arrays, **{NAME: np.array(metadata)})


def _read_npz(path: Path) -> tuple[Columns, str]:
    with ZipFile(path) as archive:
        sizes = packed_sizes(archive)
        _check_room(sum(sizes.values()))
        arrays = {
            name.removesuffix(".npy"): read_array(io.BytesIO(read_packed(archive, name)), allow_pickle=False)
            for name in sizes
        }
    return {name: array for name, array in arrays.items() if name != NAME}, str(arrays[NAME])


Writer = Callable[[Path, Iterable[Columns], str], None]
Reader = Callable[[Path], tuple[Columns, str]]
FORMATS: dict[str, tuple[Writer, Reader]] = {
    ".csv": (_write_csv, _read_csv),
    ".parquet": (_write_parquet, _read_parquet),
    ".npz": (_write_npz, _read_npz),
}


def _format(path: Path) -> tuple[Writer, Reader]:
    if path.suffix.lower() not in FORMATS:
        raise RecordingError(f"{path} has no known format: let its name end in {', '.join(FORMATS)}.")
    return FORMATS[path.suffix.lower()]
