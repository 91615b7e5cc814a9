"""Reads a recording back: exact samples, scenario, events, and how the run ended. Torn files are read up to the tear."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cache, cached_property
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from flexlab.control.law import laws
from flexlab.control.path import paths
from flexlab.errors import FlexlabError, RecordingError, ScenarioError
from flexlab.own.declaration import read_declaration, signal_name
from flexlab.recording.codec import DERIVED, decode_block, event_from_values, state_from_values
from flexlab.recording.repair import BEGIN, END, SAMPLES, Rows, check_foreign, read_rows, rows_in_order
from flexlab.recording.rerun_internals.chunks import PROPERTIES, Row
from flexlab.recording.run_info import GAPS, unchecked
from flexlab.recording.store.formats import FORMAT, Changes, checked_format, migrate, readable, same_numbers
from flexlab.recording.store.run_files import BREAKING_OFF, State, run_state
from flexlab.scenario import Scenario, parse_scenario
from flexlab.signal import COORDINATE
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Run, Samples, Status, WorldState, empty_samples, join_blocks
from flexlab.sim.signals import TABLE, own_signals
from flexlab.sim.snapshot import Event
from flexlab.text import range_text, visible

PLAIN = (str, int, float)
"""Types of properties."""
LONGEST_REASON = 200
"""Largest length of the reason why a file cannot be read, characters."""
MOST_ROWS = 1000
"""Largest number of samples in a block that is read; progress is reported after each block."""


@dataclass(frozen=True)
class Recording:
    """One run as it was recorded."""

    path: Path
    name: str
    """The preset or file that the scenario came from."""
    scenario: Scenario
    """The scenario at the first sample; `events` tell what changed later."""
    start: WorldState | None
    """The world's state at the first sample; None: the scenario's own start."""
    events: tuple[Event, ...]
    """In the order in which they took effect; their commands can be replayed."""
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
        """Number of the format in which the recording was written."""
        return int(self.properties["format"])

    @property
    def compared(self) -> frozenset[str]:
        """The table's signals that were computed then as they are today, to the last bit."""
        return same_numbers(self.computed_in)

    @cached_property
    def samples(self) -> Samples:
        """All samples, in SI units, bit for bit; those of an older format have today's meaning (see `compared`).

        They are read on the first access. Raises `RecordingError`.
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
        count = 0
        with _telling_what_is_strange(self.path, self.properties):
            hidden = _hidden_by_laws(self.scenario, self.events)
            for _, values in rows:
                block = _block(self.path, self.scenario, values, history, hidden)
                count += len(block)
                yield block
            self._check_count(count)

    def _check_count(self, count: int) -> None:
        """Raise `RecordingError` if all samples are missing, or some of an ended run that were not lost to a full disk."""
        if not count and self.status == BREAKING_OFF and self.state != "in use":
            raise RecordingError(f"{self.path} is damaged beyond repair: nothing of its run can be read.")
        due = self.properties.get("rows", 0)
        # Earlier versions did not note what was lost to a full disk.
        is_known = "events" in self.properties or (self.part == 1 and not count)
        if is_known and not self.properties.get(GAPS) and count != due:
            raise RecordingError(f"{self.path} holds {count} of {due} samples: it is damaged.")

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
    """Read a recording, up to the tear if its tail is torn. Raises `RecordingError` for any other file."""
    check_foreign(Path(path))
    rows = read_rows(Path(path), ["/exact/events", "/exact/start", PROPERTIES + "**"])
    with _telling_what_is_strange(Path(path), _values(Path(path), rows, BEGIN)):
        return _assemble(Path(path), rows)


def read_range(path: Path | str, start: float | None = None, end: float | None = None) -> Samples:
    """The samples from `start` to `end` s of simulation time; the others are not kept in memory.

    Raises `RecordingError` if there are none, or as `read_recording` does.
    """
    return join_blocks(list(within(read_recording(path).blocks(), start, end)))


def read_scenario(path: Path) -> Scenario:
    """The scenario at the start of a recording, in milliseconds for a finished file of any length. Raises `RecordingError`."""
    check_foreign(path)
    rows = read_rows(path, [PROPERTIES + "**"])
    with _telling_what_is_strange(path, _values(path, rows, BEGIN)):
        return _scenario(_properties(path, rows)["scenario"])


def _values(path: Path, rows: Rows, entity: str) -> dict[str, Any]:
    """All components of a static entity. Raises `RecordingError` if their checksum is wrong."""
    return _sound(path, {name: value for _, row in rows.get(entity, []) for name, value in row.items()})


def _sound(path: Path, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values without their checksum. Raises `RecordingError` if it is wrong."""
    try:
        return unchecked(values)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}: the recording is damaged.") from None


def _properties(path: Path, rows: Rows) -> dict[str, Any]:
    properties = _values(path, rows, BEGIN)
    if "format" not in properties or "scenario" not in properties:
        raise RecordingError(
            f"{path} is a rerun recording, but not one of flexlab's: it has no scenario, or it is damaged."
        )
    if not readable(properties):
        raise RecordingError(
            f"{path} was written by flexlab {properties['flexlab_version']}, which is newer than this one: update flexlab."
        )
    return properties


def _scenario(text: str) -> Scenario:
    given = json.loads(text)
    try:
        return parse_scenario(given)
    except ScenarioError as error:
        # Recordings do not hold the code of such kinds, and reading one must not run it.
        for part, known, add in (
            ("controller", laws(), "law.add_law_file"),
            ("trajectory", paths(), "path.add_path_file"),
        ):
            written = given[part] if part in dict(error.problems) else None
            kind = written.get("kind") if isinstance(written, dict) else None
            if isinstance(kind, str) and kind not in known:
                advice = (
                    f"If a file of yours holds it as a kernel, call flexlab.control.{add}(Path(FILE)) in Python first."
                )
                raise ScenarioError([(f"{part}.kind", f"there is no {part}.kind {kind!r:.40}. {advice}")]) from None
        raise


@contextmanager
def _telling_what_is_strange(path: Path, properties: Mapping[str, Any]) -> Iterator[None]:
    """Turn every error from content of another version, or another program, into a `RecordingError`."""
    try:
        yield
    except RecordingError:
        raise
    except json.JSONDecodeError as error:
        raise RecordingError(f"{path}: a text in it breaks off ({error}): the recording is damaged.") from None
    except (FlexlabError, ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        version = visible(properties.get("flexlab_version", "of another version"), 40)
        lacks = f"it lacks {error}." if isinstance(error, KeyError) else ""
        reason = visible(lacks or str(error).split("\n")[0], LONGEST_REASON)
        raise RecordingError(
            f"{path} was written by flexlab {version} and cannot be read by this one: {reason}"
        ) from None


def _assemble(path: Path, rows: Rows) -> Recording:
    properties = _properties(path, rows)
    end = _values(path, rows, END) | _values(path, rows, PROPERTIES + GAPS)
    scenario = _scenario(properties["scenario"])
    start = _values(path, rows, "/exact/start").get("state")
    state = None if start is None else state_from_values(json.loads(start))
    if state is None and properties.get("has_start"):
        raise RecordingError(f"{path} lacks the state in which its run began: it is damaged.")
    events = _events(path, rows, end)
    started, part = datetime.fromisoformat(properties["started"]), int(properties["part"])
    period, ended = _finite(properties["sample_period_s"]), _finite(end.get("time_s", 0.0))
    if period <= 0:
        raise ValueError(f"its sample period is {period:g} s.")
    status = Status(str(end.get("status", BREAKING_OFF)), str(end.get("text", "The recording breaks off.")), ended)
    state_of_file = run_state(path)
    if state_of_file == "complete" and status == BREAKING_OFF:  # As a mended file that was copied without its notes.
        state_of_file = "recovered"
    written_in = properties["format"]
    told = {
        name: value for name, value in (properties | end).items() if name != "scenario" and isinstance(value, PLAIN)
    }
    computed_in = checked_format(properties.get("computed_in", written_in), max(FORMAT, written_in))
    return Recording(
        path=path, name=str(properties["preset"]), scenario=scenario, start=state, events=events, status=status,
        started=started, sample_period=period, part=part, computed_in=computed_in, state=state_of_file, properties=told,
    )  # fmt: skip


def _events(path: Path, rows: Rows, end: Mapping[str, Any]) -> tuple[Event, ...]:
    """All events in order. Raises `RecordingError` if some events of an ended run are missing."""
    records = [json.loads(_sound(path, row)["record"]) for _, row in rows.get("/exact/events", [])]
    records.sort(key=lambda record: record["number"])
    events = tuple(event_from_values(record) for record in records)
    for event in events:
        _finite(event.time)
    # Rerun silently leaves out what it no longer understands. The last event of each run is its end.
    due = int(end.get("events", 1 if end else 0))
    if len(events) < due and not end.get(GAPS):
        raise RecordingError(f"{path} holds {len(events)} of at least {due} events: it is damaged.")
    return events


def _hidden_by_laws(scenario: Scenario, events: Iterable[Event]) -> tuple[frozenset[str], bool]:
    """Signals of the table that have the name of a readout of a run's laws; whether the run had one law alone."""
    changes = [event.command.changes for event in events if isinstance(event.command, ChangeScenario)]
    one_law = not any({"controller", "controller.kind", "controller.source"} & each.keys() for each in changes)
    texts = {getattr(scenario.controller, "source", ""), *(str(each.get("controller.source", "")) for each in changes)}
    names: set[str] = set()
    for text in texts - {""}:
        with suppress(ScenarioError):  # A change may have been refused.
            names.update(name for name, _ in read_declaration(text, "").signals)
    return frozenset(names & TABLE.keys()), one_law


def _told_apart(samples: Samples, hidden: frozenset[str], one_law: bool) -> Samples:
    """Samples in which readouts that took the place of a signal of the table, as they did once, have their `signal_name`.

    `hidden`: the names of such readouts. Where a run had several laws, a readout is told by its shape.
    """
    signals = samples.signals()
    own = {
        name: signal_name(name)
        for name in signals.keys() & hidden - {"time"}
        if signal_name(name) not in signals and (one_law or signals[name].ndim != 1 + len(TABLE[name].axes))
    }
    if not own:
        return samples
    found = {own.get(name, name): array for name, array in signals.items()}
    return Samples(**found, **{name: DERIVED[name](found) for name in own.keys() & DERIVED.keys()})


def _block(
    path: Path,
    scenario: Scenario,
    values: dict[str, Any],
    history: Callable[[], Changes],
    hidden: tuple[frozenset[str], bool],
) -> Samples:
    try:
        samples, written_in = decode_block(values.get("data", b""))
        samples = _told_apart(samples, *hidden)
        # Only the mesh may change during a run.
        for name in samples.signals().keys() & TABLE:
            shape, due = samples[name].shape[1:], TABLE[name].shape(len(scenario.arms), 0)
            sizes = zip(TABLE[name].axes, shape, due, strict=False)
            if len(shape) != len(due) or any(size != wanted for axis, size, wanted in sizes if axis != COORDINATE):
                raise RecordingError(f"{name} has the shape {shape}, which is not that of its scenario: it is damaged.")
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    return migrate(samples, written_in, history)


def _finite(value: Any) -> float:
    time = float(value)
    if not isfinite(time):
        raise ValueError(f"a time in it is {time} s.")
    return time


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
        within = range_text(first, last, 10)
        raise RecordingError(f"From {low:g} to {high:g} s there is no sample: choose times within {within} s.")
