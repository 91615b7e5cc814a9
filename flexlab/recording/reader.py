"""Reads a recording back: exact samples, scenario, events, and how the run ended. Torn files are read up to the tear."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from functools import cache, cached_property
from itertools import islice
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from flexlab.errors import FlexlabError, RecordingError
from flexlab.recording.codec import decode_block, event_from_values, state_from_values
from flexlab.recording.rerun_internals.chunks import PROPERTIES, Row, Unreadable, entity_times, stream_rows
from flexlab.recording.rerun_internals.tool import Mending
from flexlab.recording.store.formats import FORMAT, Changes, checked_format, migrate, readable, same_numbers
from flexlab.recording.store.run_files import State, check_recording, run_state
from flexlab.scenario import Scenario, parse_scenario
from flexlab.signal import COORDINATE
from flexlab.sim.samples import Run, Samples, Status, WorldState, empty_samples, join_blocks
from flexlab.sim.signals import TABLE, own_signals
from flexlab.sim.snapshot import Event
from flexlab.text import visible

PLAIN = (str, int, float)
"""Types of properties."""
LONGEST_REASON = 200
"""Characters of why a file cannot be read."""

MOST_ROWS = 1000
"""Most samples of a block that is read: progress is reported after each."""

SAMPLES = "/exact/samples"
"""The entity that holds them."""

Rows = dict[str, list[Row]]
"""Entity → its rows in the order of times."""


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
    events: tuple[Event, ...]
    """In the order in which they took effect; commands are there to be replayed."""
    status: Status
    """How the run ended; "running" if its writer died."""
    started: datetime
    sample_period: float
    """s."""
    part: int
    """1, or more if a full disk split the run."""
    computed_in: int
    """Number of the format that was current when its samples were computed: an import keeps it."""
    state: State
    properties: dict[str, Any]
    """Versions and circumstances."""

    @property
    def format(self) -> int:
        """Number of the format that it was written in."""
        return int(self.properties["format"])

    @property
    def compared(self) -> frozenset[str]:
        """The table's signals that were computed then as they are today, to the last bit."""
        return same_numbers(self.computed_in)

    @cached_property
    def samples(self) -> Samples:
        """Everything recorded, in SI units, bit for bit; of an older format, with today's meaning (see `compared`).

        It is read when it is first asked for. Raises `RecordingError`.
        """
        found = list(self._decoded(read_rows(self.path, [SAMPLES]).get(SAMPLES, [])))
        nothing = len(self.scenario.arms), self.scenario.payload.coordinate_count, own_signals(self.scenario)
        return join_blocks(found) if found else empty_samples(*nothing)

    def blocks(self) -> Iterator[Samples]:
        """The samples in the order of time, up to `MOST_ROWS` in a block, which takes little memory. Raises `RecordingError`."""
        is_there = "samples" in vars(self)
        for block in (self.samples,) if is_there else self._decoded(rows_in_order(self.path, SAMPLES)):
            for first in range(0, len(block), MOST_ROWS):
                yield block.slice(first, first + MOST_ROWS)

    def _decoded(self, rows: Iterable[Row]) -> Iterator[Samples]:
        history = cache(lambda: Changes(self.scenario, self.events))
        with _telling_what_is_strange(self.path, self.properties):
            for _, values in rows:
                yield _block(self.path, self.scenario, values, history)

    @cached_property
    def span(self) -> tuple[float, float]:
        """First and last instant, s. Raises `RecordingError` if there are no samples."""
        times = [(float(block.time[0]), float(block.time[-1])) for block in self.blocks()]
        if not times:
            raise RecordingError(f"{self.path.stem} has no samples.")
        return times[0][0], times[-1][1]

    @property
    def run(self) -> Run:
        """Samples, scenario and status as `flexlab.simulate` gives them."""
        return Run(**self.samples.signals(), scenario=self.scenario, status=self.status)


def read_recording(path: Path | str) -> Recording:
    """Read a recording, up to the tear if its tail is torn. Raises `RecordingError` for what is no recording."""
    rows = read_rows(Path(path), ["/exact/events", "/exact/start", PROPERTIES + "**"])
    with _telling_what_is_strange(Path(path), _values(rows, PROPERTIES + "run")):
        return _assemble(Path(path), rows)


def read_range(path: Path | str, start: float | None = None, end: float | None = None) -> Samples:
    """The samples from `start` to `end` s of simulation time; the others are not kept in memory.

    Raises `RecordingError` if there are none, or as `read_recording` does.
    """
    return join_blocks(list(within(read_recording(path).blocks(), start, end)))


def read_scenario(path: Path) -> Scenario:
    """The scenario as the run of a file began. Takes milliseconds for a finished file of any length. Raises `RecordingError`."""
    rows = read_rows(path, [PROPERTIES + "**"])
    with _telling_what_is_strange(path, _values(rows, PROPERTIES + "run")):
        return _scenario(_properties(path, rows)["scenario"])


def _values(rows: Rows, entity: str) -> dict[str, Any]:
    """All components of a static entity."""
    return {name: value for _, row in rows.get(entity, []) for name, value in row.items()}


def _properties(path: Path, rows: Rows) -> dict[str, Any]:
    properties = _values(rows, PROPERTIES + "run")
    if "format" not in properties or "scenario" not in properties:
        raise RecordingError(f"{path} is a rerun recording, but not one of flexlab's: it has no scenario.")
    if not readable(properties):
        raise RecordingError(
            f"{path} was written by flexlab {properties['flexlab_version']}, which is newer than this one: update flexlab."
        )
    return properties


def _scenario(text: str) -> Scenario:
    return parse_scenario(json.loads(text))


@contextmanager
def _telling_what_is_strange(path: Path, properties: Mapping[str, Any]) -> Iterator[None]:
    """Make one `RecordingError` of what another version, or another program, has put into a file."""
    try:
        yield
    except RecordingError:
        raise
    except (FlexlabError, ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        version = visible(properties.get("flexlab_version", "of another version"), 40)
        lacks = f"it lacks {error}." if isinstance(error, KeyError) else ""
        reason = visible(lacks or str(error).split("\n")[0], LONGEST_REASON)
        raise RecordingError(
            f"{path} was written by flexlab {version} and cannot be read by this one: {reason}"
        ) from None


def _assemble(path: Path, rows: Rows) -> Recording:
    properties, end = _properties(path, rows), _values(rows, PROPERTIES + "end")
    scenario = _scenario(properties["scenario"])
    start = _values(rows, "/exact/start").get("state")
    state = None if start is None else state_from_values(json.loads(start))
    records = [json.loads(row["record"]) for _, row in rows.get("/exact/events", [])]
    events = [event_from_values(record) for record in sorted(records, key=lambda record: record["number"])]
    for event in events:
        _finite(event.time)
    started, part = datetime.fromisoformat(properties["started"]), int(properties["part"])
    period, ended = _finite(properties["sample_period_s"]), _finite(end.get("time_s", 0.0))
    if period <= 0:
        raise ValueError(f"its sample period is {period:g} s.")
    status = Status(str(end.get("status", "running")), str(end.get("text", "The recording breaks off.")), ended)
    return Recording(
        path=path,
        name=str(properties["preset"]),
        scenario=scenario,
        start=state,
        events=tuple(events),
        status=status,
        started=started,
        sample_period=period,
        part=part,
        computed_in=checked_format(
            properties.get("computed_in", properties["format"]), max(FORMAT, properties["format"])
        ),
        state=run_state(path),
        properties={
            name: value for name, value in (properties | end).items() if name != "scenario" and isinstance(value, PLAIN)
        },
    )


def _block(path: Path, scenario: Scenario, values: dict[str, Any], history: Callable[[], Changes]) -> Samples:
    try:
        samples, written_in = decode_block(values.get("data", b""))
        _check_shapes(samples, scenario)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    return migrate(samples, written_in, history)


def _check_shapes(samples: Samples, scenario: Scenario) -> None:
    """Raises `RecordingError` for a signal of the table in another shape than the scenario's, whose mesh alone may change."""
    for name in samples.signals().keys() & TABLE:
        shape, due = samples[name].shape[1:], TABLE[name].shape(len(scenario.arms), 0)
        sizes = zip(TABLE[name].axes, shape, due, strict=False)
        if len(shape) != len(due) or any(size != wanted for axis, size, wanted in sizes if axis != COORDINATE):
            raise RecordingError(f"{name} has the shape {shape}, which is not that of its scenario: it is damaged.")


def _finite(value: Any) -> float:
    time = float(value)
    if not isfinite(time):
        raise ValueError(f"a time in it is {time} s.")
    return time


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

    A file that is torn, or whose writer is within a piece, is read through a mended copy. Raises `RecordingError`.
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
    """A whole copy of what stands before the tear. Raises `RecordingError` if nothing of the run can be read."""
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


def within(blocks: Iterable[Samples], start: float | None, end: float | None) -> Iterator[Samples]:
    """The samples with start <= time <= end (s; None: no limit), in blocks of N >= 1. `blocks`: in the order of time.

    Reads no further than needed. Raises `RecordingError` if there are none.
    """
    low, high = -np.inf if start is None else start, np.inf if end is None else end
    first = last = None
    found = False
    for block in blocks:
        first, last = float(block.time[0]) if first is None else first, float(block.time[-1])
        row, stop = np.searchsorted(block.time, low, "left"), np.searchsorted(block.time, high, "right")
        if row < stop:
            found = True
            yield block.slice(int(row), int(stop))
        elif found:
            return
    if first is None:
        raise RecordingError("The run has no samples.")
    if not found:
        low, high = first if start is None else start, last if end is None else end
        raise RecordingError(
            f"From {low:g} to {high:g} s there is no sample: choose times within {first:g} to {last:g} s."
        )
