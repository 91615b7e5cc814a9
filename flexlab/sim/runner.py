"""The simulation thread: paces a `World` by an injected clock, drains commands, publishes snapshots, feeds consumers."""

import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import numpy as np

from flexlab.errors import FlexlabError
from flexlab.scenario import Scenario
from flexlab.sim.command_text import command_text
from flexlab.sim.commands import (
    ChangeScenario,
    Command,
    LoadScenario,
    Pause,
    Play,
    Pull,
    Reset,
    SetSpeed,
    StepOnce,
    Tap,
)
from flexlab.sim.history import History
from flexlab.sim.interpolation import interpolate
from flexlab.sim.pacing import FASTEST, SLOWEST, Pacing
from flexlab.sim.samples import Samples, Status
from flexlab.sim.signals import own_signals
from flexlab.sim.snapshot import TICK, Event, Snapshot
from flexlab.sim.world import World
from flexlab.sim.world_state import Origin, WorldState

FRAME = 1 / 60
"""Wall seconds per round of the runner, s: the rate of common screens."""

BLOCK_TICKS = 64
"""Ticks advanced between two looks at the command queue: even at 4 times real time and 64 elements under 50 ms."""

EVENTS_KEPT = 200
"""Newest events that a snapshot carries."""

MOST_STEPS = 100_000
"""Most ticks that one `StepOnce` may ask for (100 s)."""


class Consumer(Protocol):
    """Who gets every sample and event. Called on the simulation thread: must return at once (enqueue, never block)."""

    def begin_run(self, run_number: int, name: str, scenario: Scenario, start: WorldState) -> None:
        """A new run starts (reset, preset, or a change of structure, after which time goes on); `start`: its state."""

    def take_samples(self, run_number: int, samples: Samples, actual_speed: float) -> int:
        """The next block (N >= 1 rows, contiguous with the block before); returns how many rows it had to drop."""
        ...

    def take_event(self, run_number: int, event: Event) -> None:
        """A command took effect, a status changed."""

    def end_run(self, run_number: int, status: Status) -> None:
        """The run is over; no more samples of this number follow."""


class Runner:
    """Owns the world and its thread. `submit` may be called from any thread; nobody else touches the world."""

    def __init__(
        self,
        scenario: Scenario,
        name: str = "scenario",
        consumers: Sequence[Consumer] = (),
        playing: bool = True,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], None] = time.sleep,
        origin: Origin | None = None,
    ):
        """Build the world; raises `ScenarioError`. An unreachable trajectory gives a runner with a failed status.

        With an `origin` the run goes on from there. Raises `FlexlabError` if its state is not one of this scenario.
        """
        self._consumers = list(consumers)
        self._clock, self._sleep = clock, sleep
        self._commands: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._stopping = threading.Event()
        self._thread: threading.Thread | None = None
        self._run_number = 0
        self._events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._dropped = 0
        self._pacing = Pacing()
        self._pacing.playing = playing
        self._load(LoadScenario(scenario, name, origin))
        self._publish(self._clock())

    def start(self) -> None:
        """Start the thread."""
        self._thread = threading.Thread(target=self._loop, name="flexlab-simulation", daemon=True)
        self._pacing.restart(self._clock(), self._world.time)
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread, end the run, return when both are done. May be called twice."""
        if self._stopping.is_set():
            return
        self._stopping.set()
        if self._thread is not None:
            self._thread.join()
        self._end()

    def submit(self, command: Command) -> None:
        """Queue a command; it takes effect at the head of the runner's next frame. Invalid ones become error events."""
        self._commands.put(command)

    @property
    def snapshot(self) -> Snapshot:
        """The newest published snapshot."""
        return self._snapshot

    def recent(self, seconds: float) -> Samples:
        """The last `seconds` of the current run at full rate (at most 30 s), for plots. A copy, any thread."""
        return self._history.recent(seconds)

    def frame(self) -> None:
        """One round: commands, then the ticks that are due, then a snapshot. The thread's body; tests call it alone."""
        self._drain()
        run, due = self._run_number, self._pacing.due_ticks(self._clock(), self._world.tick)
        while due > 0 and not self._world.status.failed and self._pacing.playing and run == self._run_number:
            block = min(due, BLOCK_TICKS)
            self._advance(block)
            due -= block
            self._drain()
        wall = self._clock()
        self._pacing.note(wall, self._world.time)
        self._publish(wall)

    def _loop(self) -> None:
        next_frame = self._clock()
        while not self._stopping.is_set():
            self.frame()
            next_frame = max(next_frame + FRAME, self._clock())
            self._sleep(max(0.0, next_frame - self._clock()))

    def _drain(self) -> None:
        while True:
            try:
                command = self._commands.get_nowait()
            except queue.Empty:
                return
            try:
                self._carry_out(command)
            except FlexlabError as error:
                self._report(Event(self._world.time, " ".join(str(error).split("\n")), level="error"))
            except Exception as error:  # A command nobody foresaw must not end everybody's lab; nor pass in silence.
                what = f"{type(command).__name__} could not be carried out ({type(error).__name__}: {error})."
                self._report(Event(self._world.time, f"{what} Nothing was changed by it.", level="error"))

    def _carry_out(self, command: Command) -> None:
        wall, world = self._clock(), self._world
        if isinstance(command, (ChangeScenario, Pull, Tap)):
            self._change(command)
        elif isinstance(command, Reset):
            new = World(world.scenario)
            self._report(Event(world.time, command_text(command), command))
            self._end()
            self._begin(new, self._name)
        elif isinstance(command, LoadScenario):
            self._load(command)
        elif isinstance(command, (Play, Pause)):
            self._play(isinstance(command, Play), wall)
            self._report(Event(world.time, command_text(command), command))
        elif isinstance(command, SetSpeed):
            self._set_speed(command, wall)
        else:
            self._step(command)

    def _load(self, command: LoadScenario) -> None:
        """Begin a run of another scenario, or one that goes on from an earlier one's state; it says so first."""
        world = World(command.scenario)
        event = Event(0.0, command_text(command), command)
        if command.origin is not None:
            world.restore(command.origin.state)
        if self._run_number:
            self._report(replace(event, time=self._world.time))
            self._end()
        self._begin(world, command.name)
        if command.origin is not None:
            self._report(replace(event, time=world.time))

    def _change(self, command: ChangeScenario | Pull | Tap) -> None:
        """Let the world take on a change; a restart or another beam structure begins a new run."""
        world = self._world
        event = Event(world.time, command_text(command), command)
        begins_anew = world.apply(command)
        self._report(event)
        if begins_anew:
            self._end()
            self._begin(world, self._name)
        else:
            self._latest = world.observe()

    def _play(self, playing: bool, wall: float) -> None:
        if playing and self._world.status.failed:
            raise FlexlabError(f"This run has stopped: {self._world.status.text} Reset, or load another preset.")
        self._pacing.playing = playing
        self._pacing.restart(wall, self._world.time)

    def _set_speed(self, command: SetSpeed, wall: float) -> None:
        if not SLOWEST <= command.speed <= FASTEST:
            raise FlexlabError(
                f"Speed = {command.speed:g} is outside 1/256 to {FASTEST:g} times real time: choose within it."
            )
        time_now = min(self._pacing.target(wall), self._world.time + TICK)
        self._pacing.speed = command.speed
        self._pacing.restart(wall, time_now)
        self._report(Event(self._world.time, command_text(command), command))

    def _step(self, command: StepOnce) -> None:
        if not 1 <= command.ticks <= MOST_STEPS:
            raise FlexlabError(f"Steps = {command.ticks} is outside 1 to {MOST_STEPS}: choose within it.")
        self._pacing.playing = False
        self._report(Event(self._world.time, command_text(command), command))
        self._advance(command.ticks)
        self._pacing.restart(self._clock(), self._world.time)

    def _begin(self, world: World, name: str) -> None:
        """Make `world` the current run and tell the consumers, its present sample included."""
        self._world, self._name = world, name
        self._run_number += 1
        self._dropped = 0
        self._events.clear()
        self._history = History(world.row_length, len(world.scenario.arms), own_signals(world.scenario))
        self._latest = self._previous = world.observe()
        self._pacing.restart(self._clock(), world.time)
        for consumer in self._consumers:
            consumer.begin_run(self._run_number, name, world.scenario, world.state())
        if world.status.failed:
            self._fail()
        else:
            self._hand_out(world.observe_rows())

    def _end(self) -> None:
        status = self._world.status
        if not status.failed:
            status = Status("finished", f"Ended at t = {self._world.time:.3f} s.", self._world.time)
        for consumer in self._consumers:
            consumer.end_run(self._run_number, status)

    def _fail(self) -> None:
        self._pacing.playing = False
        self._report(Event(self._world.time, self._world.status.text, level="error"))

    def _advance(self, ticks: int) -> None:
        rows = self._world.advance_rows(ticks)
        self._hand_out(rows)
        if self._world.status.failed:
            self._fail()

    def _hand_out(self, rows: np.ndarray) -> None:
        """Samples to history, snapshot and consumers."""
        if len(rows) == 0:
            return
        self._history.append(rows, own_signals(self._world.scenario))
        samples = self._world.to_samples(rows)
        self._previous = samples.slice(len(rows) - 2, len(rows) - 1) if len(rows) > 1 else self._latest
        self._latest = samples.slice(len(rows) - 1, len(rows))
        speed = self._pacing.actual_speed()
        for consumer in self._consumers:
            self._dropped += consumer.take_samples(self._run_number, samples, speed)

    def _report(self, event: Event) -> None:
        self._events.append(event)
        for consumer in self._consumers:
            consumer.take_event(self._run_number, event)

    def _publish(self, wall: float) -> None:
        world, latest = self._world, self._latest
        # Drawn one tick late, so that in slow motion there is always a sample on either side to draw between.
        fraction = (self._pacing.target(wall) - float(latest.time[0])) / TICK if self._pacing.playing else 1.0
        self._snapshot = Snapshot(
            run_number=self._run_number,
            name=self._name,
            scenario=world.scenario,
            status=world.status,
            playing=self._pacing.playing,
            latest=latest,
            display=interpolate(self._previous, latest, min(max(fraction, 0.0), 1.0)),
            target_speed=self._pacing.speed,
            actual_speed=self._pacing.actual_speed(),
            too_slow=self._pacing.too_slow(wall),
            dropped_samples=self._dropped,
            first_frequency=world.first_frequency,
            events=tuple(self._events),
        )
