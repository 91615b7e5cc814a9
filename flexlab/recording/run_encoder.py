"""A run's samples and events as columns for its sinks, and the rerun stream that encodes them. No thread, no queue, no files."""

import json
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import rerun as rr

from flexlab.errors import RecordingError, ScenarioError
from flexlab.recording.codec import block_bytes, encode_block, event_values, pack_block, state_json
from flexlab.recording.rerun_internals.chunks import (
    PROPERTIES,
    Column,
    line_strips,
    new_stream,
    scalars,
    send_columns,
    send_layout,
    single,
    time_column,
)
from flexlab.recording.run_info import RunInfo, RunNotes, checked, parameters_text, run_properties, signals_text
from flexlab.recording.scene_and_plots import (
    FRAMES_PER_SECOND,
    desired_path,
    fixed_shapes,
    measurement_blueprint,
    moving_shapes,
    run_blueprint,
)
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import Event
from flexlab.views import REAL_TIME_FACTOR, View, views

SAMPLES, EVENTS, RECORDS, PATH = "exact/samples", "events", "exact/events", "scene/path"
"""Entities with special treatment: viewers do not need the samples, and a file that begins later in the run gets all earlier
events and records at their own instants, and the path as it then is."""


Shown = tuple[str, np.ndarray, list[Column]]
"""Entity, instants, s, and columns."""


class Sink(Protocol):
    """One destination of a run. It reports its own errors; the encoder does not wait for it."""

    def send(self, entity: str, time: np.ndarray, columns: Iterable[Column]) -> None:
        """Take columns for the instants `time` (N,), s."""

    def log(self, entity: str, archetype: rr.AsComponents) -> None:
        """Take data that hold at all times: a curve's appearance, or a property that listings show."""


ROWS_AT_ONCE = 2000
"""Samples of which all signals are copied in turn: about a megabyte, which stays in the processor's cache meanwhile."""
LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
"""Levels of events as rerun names them."""
END = "End of the run"
"""Beginning of the text of a run's last event."""


def is_end(event: Event) -> bool:
    """Whether an event only says how a run ended, which every recording adds by itself."""
    return event.text.startswith(END)


class RunEncoder:
    """Encodes one run for any number of sinks."""

    def __init__(self, info: RunInfo, sinks: Sequence[Sink], notes: RunNotes | None = None):
        """`notes` gets all samples and events, and its result is added to the `summary`."""
        self.info = info
        self._sinks = sinks
        self._notes = notes
        self._scenario = info.scenario
        self._event_count = 0
        self._signals = views(info.scenario)
        self._last_drawn = -np.inf
        self.rows = 0
        self.last_time = 0.0
        self._first_time: float | None = None
        self._packing = ThreadPoolExecutor(1, "flexlab-packing")

    @np.errstate(over="ignore", invalid="ignore")  # Imported values may be of any size.
    def write_samples(self, samples: Samples) -> None:
        """Write a block (N >= 1): its exact samples, which another thread packs meanwhile, and its curves and drawing."""
        samples = side_by_side(samples)
        block = block_bytes(samples)
        try:
            packed = self._packing.submit(pack_block, block).result
        except RuntimeError:  # The script is ending, or the system lets no more threads begin.
            packed = partial(pack_block, block)
        self._count(samples)
        shown = list(self._shown(samples))
        self._send_exact(samples, packed())
        for each in shown:
            self._send(*each)

    def write_exact(self, samples: Samples) -> None:
        """Write a block (N >= 1) in full precision."""
        self._send_exact(samples, encode_block(samples))
        self._count(samples)

    def _send_exact(self, samples: Samples, packed: bytes) -> None:
        """Send a block at its last instant, so that no time axis ends later."""
        self._send(SAMPLES, samples.time[-1:], [single("flexlab.Block", "data", None, packed)])

    def _count(self, samples: Samples) -> None:
        """Note a block; before the first one comes the path."""
        self.rows += len(samples)
        if self._first_time is None:
            self._first_time = float(samples.time[0])
            if not self.info.measured:
                self._send_path(self._first_time)
        self.last_time = float(samples.time[-1])
        if self._notes is not None:
            self._notes.add(samples)

    def write_shown(self, samples: Samples, speed_time: Sequence[float], speed: Sequence[float]) -> None:
        """Write the curves and the drawing of a block (N >= 1). `speed`: real-time factors at the times `speed_time`, s."""
        for each in self._shown(samples, float(speed[-1]) if len(speed) else 1.0):
            self._send(*each)
        if len(speed):
            values = scalars(np.asarray(speed)[:, None])
            self._send(REAL_TIME_FACTOR.entity, np.asarray(speed_time), [values])

    def _shown(self, samples: Samples, speed: float = 1.0) -> Iterator[Shown]:
        drawn = self._frames(samples, speed)
        return shown_columns(self._scenario, self._signals, samples, drawn, self.info.exaggeration)

    def _send(self, entity: str, time: np.ndarray, columns: list[Column]) -> None:
        for sink in self._sinks:
            sink.send(entity, time, columns)

    def _log(self, shapes: Iterable[tuple[str, rr.AsComponents]]) -> None:
        for entity, archetype in shapes:
            for sink in self._sinks:
                sink.log(entity, archetype)

    def _frames(self, samples: Samples, speed: float) -> Samples:
        """The samples to draw: FRAMES_PER_SECOND per simulated second, or per wall second in slow motion."""
        interval = min(max(speed, 0.0), 1.0) / FRAMES_PER_SECOND
        if interval <= self.info.sample_period:
            chosen = np.arange(len(samples))
        else:
            # Half a sample period keeps rounding errors from deciding at a multiple of the interval.
            late = samples.time + 0.5 * self.info.sample_period
            count = np.floor(np.concatenate([[self._last_drawn], late]) / interval)
            chosen = np.flatnonzero(np.diff(count) > 0)
        self._last_drawn = float(samples.time[-1]) + 0.5 * self.info.sample_period
        return samples.take(chosen)

    def write_event(self, event: Event) -> None:
        """Write an event; a change of the scenario also changes the drawing from then on."""
        if self._notes is not None:
            self._notes.add_event(event)
        self._send_event(event)
        if isinstance(event.command, ChangeScenario) and event.level != "error":
            self._follow(event.command, event.time)

    def _follow(self, change: ChangeScenario, time: float) -> None:
        try:
            self._scenario = self._scenario.replace(change.changes)
        except ScenarioError:
            return  # A change that only the engine can follow; the drawing stays.
        known = {signal.entity for signal in self._signals}
        new = tuple(signal for signal in views(self._scenario) if signal.entity not in known)
        self._signals += new  # Another law may have signals of its own.
        self._log((signal.entity, curves(signal.names, signal.colors)) for signal in new)
        if any(path.startswith("trajectory") for path in change.changes):
            self._send_path(time)

    def _send_path(self, time: float) -> None:
        """Send the path at an instant of the run: the viewer's time axis begins with the first data."""
        self._send(PATH, np.array([time]), [line_strips(desired_path(self._scenario))])

    def _send_event(self, event: Event) -> None:
        """Send an event; its number keeps the events of one instant in order."""
        time = np.array([event.time])
        lines = [
            single("TextLog", "text", "Text", f"t = {event.time:.3f} s: {event.text}"),
            single("TextLog", "level", "TextLogLevel", LEVELS.get(event.level, "INFO")),
        ]
        record = checked({"record": self._record(self._event_count, event)})
        self._send(EVENTS, time, lines)
        self._send(RECORDS, time, [single("flexlab.Event", name, None, text) for name, text in record.items()])
        self._event_count += 1

    def _record(self, number: int, event: Event) -> str:
        """An event as JSON with its exact time."""
        places = {"number": number, "tick": round(event.time / self.info.sample_period)}
        return json.dumps(places | event_values(event), ensure_ascii=False)

    def end(self, status: Status, dropped: int = 0) -> None:
        """Write how the run ended; close the sinks after this."""
        level = "error" if status.failed else "info"
        self._send_event(Event(status.time or self.last_time, f"{END}: {status.text}", level=level))
        counts = {"rows": self.rows, "dropped": dropped, "events": self._event_count}
        values = checked({"status": str(status), "text": status.text, "time_s": self.last_time, **counts})
        self._log([(PROPERTIES + "end", rr.AnyValues(**values))])

    def summary(self, status: Status, dropped: int) -> dict[str, Any]:
        """The notes on a run that has ended."""
        notes = {} if self._notes is None else self._notes.result(status)
        return {
            "ended": True,
            "preset": self.info.name,
            "started": self.info.started.isoformat(timespec="seconds"),
            "status": str(status),
            **({"why_stopped": status.text} if status.failed else {}),
            "begins": self._first_time or 0.0,
            "duration": self.last_time - (self._first_time or 0.0),
            "rows": self.rows,
            "dropped": dropped,
            **notes,
        }


def side_by_side(samples: Samples) -> Samples:
    """The same samples, each signal in memory of its own: those of a run lie interleaved, which makes all work on them slow."""
    signals = samples.signals()
    # One piece of memory for all: the system maps a large piece at once, and many small ones page by page.
    memory, end = np.empty(sum(signal.size for signal in signals.values())), 0
    copies: dict[str, np.ndarray] = {}
    for name, signal in signals.items():
        copies[name] = memory[end : end + signal.size].reshape(signal.shape)
        end += signal.size
    for start in range(0, len(samples), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        for name, signal in signals.items():
            copies[name][rows] = signal[rows]
    return Samples(**copies)


def shown_columns(
    scenario: Scenario, signals: Iterable[View], samples: Samples, drawn: Samples, factor: float
) -> Iterator[Shown]:
    """The curves of some samples, and of the drawing of `drawn`, its deflection times `factor`."""
    for signal in signals:
        values = signal.values(samples, np.float32)
        if not np.isnan(values).all():  # A signal that was not recorded has no curve.
            yield signal.entity, samples.time, [scalars(values)]
    if len(drawn) and not np.isnan(drawn.pose).all():  # A measured run has no pose.
        for entity, columns in moving_shapes(scenario, drawn, factor):
            yield entity, drawn.time, columns


APPLICATION = "flexlab"
"""Rerun keeps one layout per application: a person's changes to it hold for the next run that is watched live."""
FLUSH_TIMEOUT = 30.0
"""Time after which rerun's encoder counts as failed, s."""


class RunStream:
    """A rerun stream that begins with a description of the run; encoded data wait for `read`. Not for two threads at once."""

    def __init__(self, info: RunInfo, live: bool = False, file: Path | None = None):
        """`live`: for viewers of a run as it comes, which do not need exact samples.

        `file`: rerun itself writes the data to this file, and finishes it at `close`; nothing waits. Raises `RecordingError`.
        """
        self._stream = new_stream(APPLICATION, info.run_id)
        self._encoded = self._stream.binary_stream() if file is None else None
        self._live = live
        self._newest: tuple[np.ndarray, rr.TimeColumn] | None = None
        """The newest instants, and their column."""
        # Active, not only the default: for the first pieces of a file without an index the viewer makes a layout of its own,
        # which it would keep.
        if info.measured:
            layout = measurement_blueprint(info.scenario)
        else:
            layout = run_blueprint(info.scenario, info.exaggeration, info.name, live)
        try:
            self._stream.set_sinks(rr.FileSink(file) if file else self._encoded)
            send_layout(self._stream, layout)
            self._introduce(info)
        except (RuntimeError, ValueError, OSError) as error:
            self.close()
            raise RecordingError(f"The recording cannot be opened: {_one_line(error)}") from None

    def _introduce(self, info: RunInfo) -> None:
        stream, scenario = self._stream, info.scenario
        stream.send_recording_name(info.title)
        self.log(PROPERTIES + "run", run_properties(info))
        self.log("parameters", rr.TextDocument(parameters_text(info), media_type="text/markdown"))
        self.log("signals", rr.TextDocument(signals_text(scenario), media_type="text/markdown"))
        for signal in (*views(scenario), REAL_TIME_FACTOR):
            self.log(signal.entity, curves(signal.names, signal.colors))
        if not info.measured:
            for entity, shape in fixed_shapes(scenario):
                self.log(entity, shape)
        if info.start is not None:
            self.log("exact/start", rr.AnyValues(**checked({"state": state_json(info.start)})))
        # `log` goes through a batcher that `send_columns` overtakes.
        stream.flush(timeout_sec=FLUSH_TIMEOUT)

    def log(self, entity: str, archetype: rr.AsComponents) -> None:
        """Send data that hold at all times."""
        self._stream.log(entity, archetype, static=True)

    def send(self, entity: str, time: np.ndarray, columns: Iterable[Column]) -> None:
        """Send columns for the instants `time` (N,), s. Returns at once."""
        if self._live and entity == SAMPLES:
            return
        if self._newest is None or self._newest[0] is not time:  # All curves of a block share its instants.
            self._newest = time, time_column(time)
        send_columns(self._stream, entity, self._newest[1], columns)

    def read(self) -> bytes:
        """Return the data sent since the last call as one piece of a rerun file, or b"". Raises `RecordingError`."""
        if self._encoded is None:
            return b""
        try:
            return self._encoded.read(flush_timeout_sec=FLUSH_TIMEOUT) or b""
        except (RuntimeError, ValueError) as error:
            raise RecordingError(f"Rerun does not encode: {_one_line(error)}") from None

    def close(self) -> None:
        """End the stream; data that were not read are lost."""
        self._stream.disconnect()


def curves(names: Sequence[str], colors: Sequence[tuple[int, int, int]]) -> rr.SeriesLines:
    """Names and appearance of the curves of one entity."""
    # The default policy averages: a 44 Hz ring would shrink as one zooms out.
    policy = rr.components.AggregationPolicy.MinMax
    return rr.SeriesLines(names=list(names), colors=list(colors), widths=[1.5] * len(names), aggregation_policy=policy)


def _one_line(error: BaseException) -> str:
    return str(error).strip().split("\n")[0].rstrip(".") + "."
