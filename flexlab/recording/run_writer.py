"""Turns a run's samples and events into what its streams hold. No thread, no queue, no file names: see `writer`."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from flexlab.errors import RecordingError, ScenarioError
from flexlab.recording.commands_json import command_to_json
from flexlab.recording.recorded_plots import REAL_TIME_FACTOR, plot_signals
from flexlab.recording.rerun_internals.columns import blobs, line_strips, scalars, texts
from flexlab.recording.run_info import RunInfo
from flexlab.recording.run_notes import StartNotes
from flexlab.recording.run_stream import RunStream
from flexlab.recording.sample_codec import encode_block
from flexlab.recording.scene_log import FRAMES_PER_SECOND, desired_path, moving_shapes
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import Event

LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
"""Levels of events as rerun names them."""

END = "End of the run"
"""How a run's last event begins."""


class RunWriter:
    """One run on its way into any number of streams."""

    def __init__(self, info: RunInfo, start_notes: StartNotes | None = None):
        """`start_notes`: what is to be noted beside what this writer says of a run that has ended."""
        self.info = info
        self._notes = None if start_notes is None else start_notes(info)
        self.streams: list[RunStream] = []
        self._scenario = info.scenario
        self._events: list[Event] = []
        self._signals = plot_signals(info.scenario)
        self._last_drawn = -np.inf
        self.rows = 0
        self.last_time = 0.0
        self._first_time: float | None = None

    def add_stream(self, stream: RunStream) -> None:
        """Let a stream take part; it is told all events so far (a recording that resumes can then be replayed too)."""
        self.streams.append(stream)
        if self._first_time is not None:
            self._send_path([stream], self.last_time)
        if self._events:
            self._send_events([stream], self._events)

    def write_samples(self, samples: Samples, speed_time: Sequence[float] = (), speed: Sequence[float] = ()) -> None:
        """Write a block (N >= 1), exact and shown. `speed`: real-time factors at the simulation times `speed_time`, s."""
        self.write_exact(samples)
        self.write_shown(samples, speed_time, speed)

    def write_exact(self, samples: Samples) -> None:
        """Write a block (N >= 1) in full precision only, at its last instant, so that no time axis ends later."""
        column = blobs("flexlab.Block", "data", [encode_block(samples)])
        for stream in self.streams:
            if stream.exact:
                stream.send("exact/samples", samples.time[-1:], [column])
        self.rows += len(samples)
        if self._first_time is None:
            self._first_time = float(samples.time[0])
            self._send_path(self.streams, self._first_time)
        self.last_time = float(samples.time[-1])
        if self._notes is not None:
            self._notes.add(samples)

    def write_shown(self, samples: Samples, speed_time: Sequence[float], speed: Sequence[float]) -> None:
        """Write what a viewer shows of a block (N >= 1): curves and drawing."""
        for signal in self._signals:
            values = signal.values(samples)
            if not np.isnan(values).all():  # A signal that was not recorded has no curve.
                self._send(signal.entity, samples.time, [scalars(values)])
        if len(speed):
            values = scalars(np.asarray(speed)[:, None])
            self._send(REAL_TIME_FACTOR.entity, np.asarray(speed_time), [values])
        drawn = self._frames(samples, float(speed[-1]) if len(speed) else 1.0)
        if len(drawn):
            for entity, columns in moving_shapes(self._scenario, drawn, self.info.exaggeration):
                self._send(entity, drawn.time, columns)

    def _send(self, entity: str, time: np.ndarray, columns: list) -> None:
        for stream in self.streams:
            stream.send(entity, time, columns)

    def _frames(self, samples: Samples, speed: float) -> Samples:
        """The samples to draw: FRAMES_PER_SECOND a simulated second, in slow motion as many a wall second."""
        interval = min(max(speed, 0.0), 1.0) / FRAMES_PER_SECOND
        if interval <= self.info.sample_period:
            chosen = np.arange(len(samples))
        else:
            # Half a sample period keeps a multiple of the interval from falling on either side by rounding.
            late = samples.time + 0.5 * self.info.sample_period
            count = np.floor(np.concatenate([[self._last_drawn], late]) / interval)
            chosen = np.flatnonzero(np.diff(count) > 0)
        self._last_drawn = float(samples.time[-1]) + 0.5 * self.info.sample_period
        return samples.take(chosen)

    def write_event(self, event: Event) -> None:
        """Write an event; a change of the scenario also moves what is drawn from then on."""
        self._events.append(event)
        if self._notes is not None:
            self._notes.add_event(event)
        self._send_events(self.streams, [event], first=len(self._events) - 1)
        if isinstance(event.command, ChangeScenario) and event.level != "error":
            self._follow(event.command, event.time)

    def _follow(self, change: ChangeScenario, time: float) -> None:
        try:
            self._scenario = self._scenario.replace(change.changes)
        except ScenarioError:
            return  # The engine accepted it, so this is a change that only the engine can follow; the drawing stays.
        known = {signal.entity for signal in self._signals}
        new = tuple(signal for signal in plot_signals(self._scenario) if signal.entity not in known)
        self._signals += new  # Another law may have signals of its own.
        for stream in self.streams:
            stream.name_curves(new)
        if any(path.startswith("trajectory") for path in change.changes):
            self._send_path(self.streams, time)

    def _send_path(self, streams: Sequence[RunStream], time: float) -> None:
        """At an instant of the run, not before: the viewer's time begins with the first thing it is told."""
        for stream in streams:
            stream.send("scene/path", np.array([time]), [line_strips(desired_path(self._scenario))])

    def _send_events(self, streams: Sequence[RunStream], events: Sequence[Event], first: int = 0) -> None:
        """`first`: number of the first one, which keeps those of one instant in order."""
        time = np.array([event.time for event in events])
        lines = [
            texts("TextLog", "text", "Text", [f"t = {event.time:.3f} s: {event.text}" for event in events]),
            texts("TextLog", "level", "TextLogLevel", [LEVELS.get(event.level, "INFO") for event in events]),
        ]
        records = [
            texts(
                "flexlab.Event",
                "record",
                None,
                [self._record(number, event) for number, event in enumerate(events, first)],
            )
        ]
        for stream in streams:
            stream.send("events", time, lines)
            stream.send("exact/events", time, records)

    def _record(self, number: int, event: Event) -> str:
        """An event as JSON with its exact time."""
        command = None if event.command is None else json.loads(command_to_json(event.command))
        record = {"number": number, "time": event.time, "tick": round(event.time / self.info.sample_period)}
        return json.dumps(record | {"text": event.text, "level": event.level, "command": command}, ensure_ascii=False)

    def end(self, status: Status, dropped: int = 0) -> None:
        """Say how the run ended, then close all streams. Raises `RecordingError` if a file does not take it all."""
        text = Event(status.time or self.last_time, f"{END}: {status.text}", level="error" if status.failed else "info")
        self._send_events(self.streams, [text], first=len(self._events))
        values = {"status": str(status), "text": status.text, "time_s": self.last_time, "rows": self.rows}
        for stream in self.streams:
            stream.send_property("end", rr.AnyValues(**values, dropped=dropped))
        self.close()

    def summary(self, status: Status, dropped: int) -> dict[str, Any]:
        """What the notes beside the file say of a run that has ended."""
        notes = {} if self._notes is None else self._notes.result()
        return {
            "ended": True,
            "preset": self.info.name,
            "started": self.info.started.isoformat(timespec="seconds"),
            "status": str(status),
            "begins": self._first_time or 0.0,
            "duration": self.last_time - (self._first_time or 0.0),
            "rows": self.rows,
            "dropped": dropped,
            **notes,
        }

    def close(self) -> None:
        """Close all streams without a word (the run goes on elsewhere or was lost). Raises `RecordingError`."""
        problems = []
        while self.streams:
            try:
                self.streams.pop().close()
            except RecordingError as error:
                problems.append(error)
        if problems:
            raise problems[0]

    def drop_stream(self, stream: RunStream) -> None:
        """Go on without a stream whose file is lost."""
        self.streams.remove(stream)
        stream.abandon()
