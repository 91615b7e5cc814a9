"""The current run: its world, its newest samples, its events, and the consumers that follow it."""

from collections import deque
from collections.abc import Sequence

import numpy as np

from flexlab.sim.commands import Command, command_text
from flexlab.sim.history import Checkpoints, History
from flexlab.sim.samples import Samples, Status
from flexlab.sim.signals import own_signals
from flexlab.sim.simulate import end_status
from flexlab.sim.snapshot import Consumer, Event
from flexlab.sim.world import World

EVENTS_KEPT = 200
"""Number of newest events in a snapshot."""


class LiveRun:
    """One run after another, each from `begin` to `end`.

    Not thread-safe: belongs to the simulation thread; `history` and `checkpoints` may be read.
    """

    world: World
    name: str
    history: History
    checkpoints: Checkpoints
    latest: Samples
    """The newest sample (N = 1)."""
    previous: Samples
    """The sample before it, for interpolation."""
    start_time: float
    """Simulation time at which the run began, s."""

    def __init__(self, consumers: Sequence[Consumer]):
        self._consumers = list(consumers)
        self.number = 0
        self.events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self.dropped = 0
        """Samples that consumers could not take."""
        self.pace_warning = self._accuracy_warning = ""
        self._model_level = 0

    def begin(self, world: World, name: str) -> None:
        """Make `world` the current run and tell the consumers, its present sample included."""
        self.world, self.name, self.start_time = world, name, world.time
        self.number += 1
        self.dropped, self.pace_warning, self._accuracy_warning = 0, "", world.accuracy_warning
        self._model_level = world.model_warning.level
        self.events.clear()
        self.history = History(world.row_length, len(world.scenario.arms), own_signals(world.scenario))
        self.checkpoints = Checkpoints(world)
        self.latest = self.previous = world.observe()
        for consumer in self._consumers:
            consumer.begin_run(self.number, name, world.scenario, world.state())
        if not world.status.failed:
            self._hand_out(world.observe_rows(), 0.0)
            self._announce_pace()

    def end(self, status: Status) -> None:
        """Tell the consumers how the run ended."""
        for consumer in self._consumers:
            consumer.end_run(self.number, status)

    def final_status(self) -> Status:
        """The status of the run if it ends now."""
        return end_status(self.world, f"Ended at t = {self.world.time:.3f} s.")

    def take_rows(self, rows: np.ndarray, speed: float) -> None:
        """Hand out the newest samples, and report new warnings. `speed`: simulated over wall time."""
        self._hand_out(rows, speed)
        if self.world.accuracy_warning != self._accuracy_warning:
            self._accuracy_warning = self.world.accuracy_warning
            self.say(self._accuracy_warning, "warning")
        beyond = self.world.model_warning
        if beyond.level > self._model_level:
            self.say(beyond.text, "warning")
        self._model_level = beyond.level
        self._announce_pace()

    def take_on_change(self) -> None:
        """Follow a change of the world at this instant: what is drawn changes, no sample is added."""
        self.latest = self.world.observe()
        self.checkpoints.note(self.world)
        self._announce_pace()

    def report(self, event: Event) -> None:
        """Keep an event and tell the consumers."""
        self.events.append(event)
        for consumer in self._consumers:
            consumer.take_event(self.number, event)

    def note(self, command: Command) -> None:
        """Report a command that took effect at the present instant."""
        self.report(Event(self.world.time, command_text(command), command))

    def say(self, text: str, level: str) -> None:
        """Report a sentence at the present instant."""
        self.report(Event(self.world.time, text, level=level))

    def _announce_pace(self) -> None:
        """Report once that the run is slower than real time, before anybody waits for it."""
        warning, before = self.world.pace_warning, self.pace_warning
        if warning and not before:
            self.say(warning, "warning")
        self.pace_warning = warning

    def _hand_out(self, rows: np.ndarray, speed: float) -> None:
        if len(rows) == 0:
            return
        self.history.append(rows, own_signals(self.world.scenario))
        self.checkpoints.follow(self.world)
        samples = self.world.to_samples(rows)
        self.previous = samples.slice(len(rows) - 2, len(rows) - 1) if len(rows) > 1 else self.latest
        self.latest = samples.slice(len(rows) - 1, len(rows))
        for consumer in self._consumers:
            self.dropped += consumer.take_samples(self.number, samples, speed)
