"""Turns a run's samples and events into columns for its sinks. No thread, no queue, no files: see `recorder`."""

import json
from collections.abc import Iterable, Sequence
from typing import Any, Literal, Protocol

import numpy as np
import rerun as rr

from flexlab.errors import ScenarioError
from flexlab.recording.codec import command_to_json, encode_block
from flexlab.recording.rerun_internals.chunks import Column, blobs, line_strips, scalars, texts
from flexlab.recording.run_info import RunInfo, StartNotes
from flexlab.recording.scene_log import FRAMES_PER_SECOND, desired_path, moving_shapes
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Samples, Status
from flexlab.sim.snapshot import Event
from flexlab.views import REAL_TIME_FACTOR, View, views

Kept = Literal["no", "as it was", "as it stands"]
"""Whether a file that begins later in the run is told: not, as it was then, or from its beginning on (the latest only)."""


class Sink(Protocol):
    """One place that a run goes to. It tells of its own troubles; the encoder does not wait for it."""

    def send(
        self, entity: str, time: np.ndarray, columns: Iterable[Column], *, exact: bool = False, kept: Kept = "no"
    ) -> None:
        """Take columns for the instants `time` (N,), s. `exact`: only for who keeps samples in full precision."""

    def name_curves(self, signals: Iterable[View]) -> None:
        """Take what the curves are called that will be sent, and how they look."""

    def send_property(self, name: str, values: rr.AsComponents) -> None:
        """Take a property, as seen in listings."""


LEVELS = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
"""Levels of events as rerun names them."""

END = "End of the run"
"""How a run's last event begins."""


class RunEncoder:
    """One run on its way into any number of sinks."""

    def __init__(self, info: RunInfo, sinks: Sequence[Sink], start_notes: StartNotes | None = None):
        """`start_notes`: what is to be noted beside what this encoder says of a run that has ended."""
        self.info = info
        self._sinks = sinks
        self._notes = None if start_notes is None else start_notes(info)
        self._scenario = info.scenario
        self._event_count = 0
        self._signals = views(info.scenario)
        self._last_drawn = -np.inf
        self.rows = 0
        self.last_time = 0.0
        self._first_time: float | None = None

    def write_samples(self, samples: Samples, speed_time: Sequence[float] = (), speed: Sequence[float] = ()) -> None:
        """Write a block (N >= 1), exact and shown. `speed`: real-time factors at the simulation times `speed_time`, s."""
        self.write_exact(samples)
        self.write_shown(samples, speed_time, speed)

    def write_exact(self, samples: Samples) -> None:
        """Write a block (N >= 1) in full precision only, at its last instant, so that no time axis ends later."""
        column = blobs("flexlab.Block", "data", [encode_block(samples)])
        self._send("exact/samples", samples.time[-1:], [column], exact=True)
        self.rows += len(samples)
        if self._first_time is None:
            self._first_time = float(samples.time[0])
            if not self.info.measured:
                self._send_path(self._first_time)
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
        if len(drawn) and not np.isnan(drawn.pose).all():  # A measurement of a beam does not tell where it was.
            for entity, columns in moving_shapes(self._scenario, drawn, self.info.exaggeration):
                self._send(entity, drawn.time, columns)

    def _send(
        self, entity: str, time: np.ndarray, columns: list[Column], exact: bool = False, kept: Kept = "no"
    ) -> None:
        for sink in self._sinks:
            sink.send(entity, time, columns, exact=exact, kept=kept)

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
        if self._notes is not None:
            self._notes.add_event(event)
        self._send_event(event)
        if isinstance(event.command, ChangeScenario) and event.level != "error":
            self._follow(event.command, event.time)

    def _follow(self, change: ChangeScenario, time: float) -> None:
        try:
            self._scenario = self._scenario.replace(change.changes)
        except ScenarioError:
            return  # The engine accepted it, so this is a change that only the engine can follow; the drawing stays.
        known = {signal.entity for signal in self._signals}
        new = tuple(signal for signal in views(self._scenario) if signal.entity not in known)
        self._signals += new  # Another law may have signals of its own.
        for sink in self._sinks:
            sink.name_curves(new)
        if any(path.startswith("trajectory") for path in change.changes):
            self._send_path(time)

    def _send_path(self, time: float) -> None:
        """At an instant of the run, not before: the viewer's time begins with the first thing it is told."""
        self._send("scene/path", np.array([time]), [line_strips(desired_path(self._scenario))], kept="as it stands")

    def _send_event(self, event: Event) -> None:
        """Numbered, which keeps those of one instant in order."""
        time = np.array([event.time])
        lines = [
            texts("TextLog", "text", "Text", [f"t = {event.time:.3f} s: {event.text}"]),
            texts("TextLog", "level", "TextLogLevel", [LEVELS.get(event.level, "INFO")]),
        ]
        record = texts("flexlab.Event", "record", None, [self._record(self._event_count, event)])
        self._send("events", time, lines, kept="as it was")
        self._send("exact/events", time, [record], kept="as it was")
        self._event_count += 1

    def _record(self, number: int, event: Event) -> str:
        """An event as JSON with its exact time."""
        command = None if event.command is None else json.loads(command_to_json(event.command))
        record = {"number": number, "time": event.time, "tick": round(event.time / self.info.sample_period)}
        return json.dumps(record | {"text": event.text, "level": event.level, "command": command}, ensure_ascii=False)

    def end(self, status: Status, dropped: int = 0) -> None:
        """Say how the run ended. The sinks are then to be closed."""
        self._send_event(
            Event(status.time or self.last_time, f"{END}: {status.text}", level="error" if status.failed else "info")
        )
        values = {"status": str(status), "text": status.text, "time_s": self.last_time, "rows": self.rows}
        for sink in self._sinks:
            sink.send_property("end", rr.AnyValues(**values, dropped=dropped))

    def summary(self, status: Status, dropped: int) -> dict[str, Any]:
        """What the notes beside the file say of a run that has ended."""
        notes = {} if self._notes is None else self._notes.result(status)
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
