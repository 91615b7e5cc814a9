"""Reads a recording back: exact samples, scenario, events, and how the run ended. Torn files are read up to the tear."""

import json
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import LazyChunkStream, RrdReader

from flexlab.errors import RecordingError, ScenarioError
from flexlab.recording.blocks import decode_block, join_blocks
from flexlab.recording.chunks import TIMELINE
from flexlab.recording.commands_json import command_from_json
from flexlab.recording.documents import FORMAT, state_from_json
from flexlab.recording.finishing import Mending
from flexlab.recording.run_files import MAGIC, State, run_state
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim.columns import row_length, rows_to_samples
from flexlab.sim.samples import Run, Samples, Status
from flexlab.sim.snapshot import Event
from flexlab.sim.world import WorldState

PROPERTIES = "/__properties/"
"""Where rerun keeps a recording's properties."""
ROW_ID = "rerun.controls.RowId"
"""Rerun's own column, of no interest here."""


@dataclass(frozen=True)
class Recording:
    """One run as it was recorded."""

    path: Path
    name: str
    """The preset or file that the scenario came from."""
    scenario: Scenario
    """As it was at the first sample; `events` tell what changed later."""
    start: WorldState | None
    """The world's state at the first sample; None: the scenario's own start."""
    samples: Samples
    """Everything recorded, in SI units, bit for bit."""
    events: tuple[Event, ...]
    """In the order in which they took effect; commands are there to be replayed."""
    status: Status
    """How the run ended; "running" if its writer died."""
    started: datetime
    sample_period: float
    """s."""
    part: int
    """1, or more if a full disk split the run."""
    state: State
    properties: dict[str, Any]
    """Versions and circumstances."""

    @property
    def run(self) -> Run:
        """Samples, scenario and status as `flexlab.simulate` gives them."""
        signals = {name: getattr(self.samples, name) for name in Samples.__dataclass_fields__}
        return Run(**signals, scenario=self.scenario, status=self.status)


def read_recording(path: Path | str) -> Recording:
    """Read a recording, with a torn tail too. Raises `RecordingError` with one sentence for what is none."""
    return _assemble(Path(path), _read(Path(path), ["/exact/**", PROPERTIES + "**"]))


def read_scenario(path: Path | str) -> tuple[str, Scenario]:
    """(name, scenario) of a recording; of a finished one in milliseconds, however long. Raises `RecordingError`."""
    properties = _properties(Path(path), _read(Path(path), [PROPERTIES + "**"]))
    return properties["preset"], _scenario(Path(path), properties)


def _read(path: Path, content: list[str]) -> "Rows":
    """The rows of the entities that match; of a torn file through a mended copy. Raises `RecordingError`."""
    check_recording(path)
    try:
        return _rows_by_entity(path, content)
    except _Unreadable:
        with TemporaryDirectory(prefix="flexlab-") as folder:
            mended = Path(folder) / path.name
            try:
                if Mending().rewrite(path, mended):
                    return _rows_by_entity(mended, content)
            except _Unreadable:
                pass
    raise RecordingError(f"{path} is damaged beyond repair: nothing of its run can be read.")


class _Unreadable(Exception):
    """Rerun refuses the file."""


Rows = dict[str, list[tuple[int, dict[str, Any]]]]
"""Entity → (time in ns, component → value) in the order of times."""


def check_recording(path: Path) -> None:
    """Look whether a file can be a rerun recording at all. Raises `RecordingError` with the reason if not."""
    try:
        with path.open("rb") as file:
            head = file.read(len(MAGIC))
    except FileNotFoundError:
        raise RecordingError(f"There is no recording {path}: check the name.") from None
    except OSError as error:
        raise RecordingError(f"{path} cannot be read ({error.strerror}): check its name and rights.") from None
    if not head:
        raise RecordingError(f"{path} is empty: its run was lost before anything was written.")
    if head != MAGIC:
        raise RecordingError(
            f"{path} is not a rerun recording: choose a file that ends in .rrd and was made by flexlab."
        )


def _rows_by_entity(path: Path, content: list[str]) -> Rows:
    rows: Rows = {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # That a file has no index yet is no news here.
            reader = RrdReader(path)
            if not reader.recordings():
                raise _Unreadable
            for chunk in _stream(reader).filter(content=content):
                rows.setdefault(chunk.entity_path, []).extend(_rows(chunk.to_record_batch()))
    except (ValueError, RuntimeError, OSError) as error:
        raise _Unreadable from error
    for entity in rows.values():
        entity.sort(key=lambda row: row[0])
    return rows


def _stream(reader: RrdReader) -> LazyChunkStream:
    """All chunks; by the index, if the file has one, so that a filter leaves the others on the disk."""
    try:
        return reader.store().stream()
    except (ValueError, RuntimeError):
        return reader.stream()


def _rows(batch: pa.RecordBatch) -> Iterator[tuple[int, dict[str, Any]]]:
    """(time in ns, component → first value) of each row; what has no time stands at -1."""
    names = batch.schema.names
    time = batch.column(TIMELINE).cast(pa.int64()).to_pylist() if TIMELINE in names else [-1] * batch.num_rows
    components = [name for name in names if name not in (TIMELINE, ROW_ID)]
    columns = {name.rpartition(":")[2]: batch.column(name).to_pylist() for name in components}
    for row, instant in enumerate(time):
        yield instant, {name: column[row][0] for name, column in columns.items() if column[row]}


def _values(rows: Rows, entity: str) -> dict[str, Any]:
    """All components of an entity that does not change."""
    return {name: value for _, row in rows.get(entity, []) for name, value in row.items()}


def _properties(path: Path, rows: Rows) -> dict[str, Any]:
    properties = _values(rows, PROPERTIES + "run")
    if "format" not in properties or "scenario" not in properties:
        raise RecordingError(f"{path} is a rerun recording, but not one of flexlab's: it has no scenario.")
    if properties["format"] > FORMAT:
        raise RecordingError(
            f"{path} was written by flexlab {properties['flexlab_version']}, which is newer than this one: update flexlab."
        )
    return properties


def _scenario(path: Path, properties: dict[str, Any]) -> Scenario:
    try:
        return parse_scenario(json.loads(properties["scenario"]))
    except (ValueError, ScenarioError) as error:
        raise _strange(path, properties, error) from None


def _strange(path: Path, properties: dict[str, Any], error: Exception) -> RecordingError:
    version = properties.get("flexlab_version", "of another version")
    reason = str(error).split("\n")[0]
    return RecordingError(f"{path} was written by flexlab {version} and cannot be read by this one: {reason}")


def _assemble(path: Path, rows: Rows) -> Recording:
    properties, end = _properties(path, rows), _values(rows, PROPERTIES + "end")
    scenario = _scenario(path, properties)
    try:
        start = _values(rows, "/exact/start").get("state")
        state = None if start is None else state_from_json(start)
        records = [json.loads(row["record"]) for _, row in rows.get("/exact/events", [])]
        events = [_event(record) for record in sorted(records, key=lambda record: record["number"])]
    except (ValueError, KeyError, TypeError) as error:
        raise _strange(path, properties, error) from None
    blocks = [decode_block(row["data"]) for _, row in rows.get("/exact/samples", [])]
    samples = join_blocks(blocks) if blocks else _no_samples(scenario)
    status = Status(end.get("status", "running"), end.get("text", "The recording breaks off."), end.get("time_s", 0.0))
    return Recording(
        path=path,
        name=properties["preset"],
        scenario=scenario,
        start=state,
        samples=samples,
        events=tuple(events),
        status=status,
        started=datetime.fromisoformat(properties["started"]),
        sample_period=properties["sample_period_s"],
        part=properties["part"],
        state=run_state(path),
        properties={name: value for name, value in properties.items() if name != "scenario"} | end,
    )


def _event(record: dict[str, Any]) -> Event:
    command = record["command"]
    known = None if command is None else command_from_json(json.dumps(command))
    return Event(record["time"], record["text"], known, record["level"])


def _no_samples(scenario: Scenario) -> Samples:
    arms = len(scenario.arms)
    return rows_to_samples(np.zeros((0, row_length(arms, scenario.payload.coordinate_count))), arms)
