"""The live run: its world, its newest samples, its events, the consumers that follow it, and its pace by a clock.

Simulation time follows a target line with a budget for each frame; a backlog is dropped, not caught up (`pacing`).
"""

import threading
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from flexlab.errors import FlexlabError
from flexlab.sim.command_queue import MOST_STEPS
from flexlab.sim.commands import Command, command_text
from flexlab.sim.history import Checkpoints, History
from flexlab.sim.pacing import FASTEST, SLOWEST, Pacing, RunRate, interpolate
from flexlab.sim.samples import Samples, Status
from flexlab.sim.signals import own_signals
from flexlab.sim.simulate import end_status
from flexlab.sim.snapshot import TICK, Consumer, Event, Snapshot
from flexlab.sim.world import World
from flexlab.text import number_text

EVENTS_KEPT = 200
"""Number of newest events in a snapshot."""
FRAME_BUDGET = 0.03
"""Wall seconds after which a frame publishes what there is and leaves the rest to the next: a picture every 50 ms."""
BLOCK_TIME, LARGEST_BLOCK, GROWTH = 0.01, 64, 4
"""Wall seconds that a block of ticks may take, so that commands wait no longer; its largest number of ticks; and the factor by
which it may exceed the block before it: the cost of a tick is unknown before one is done."""
DRAG_PAUSE = 0.5
"""Wall seconds within which a second change that begins a run counts as the next value of a dragged slider: its run does not wait
to be released."""


class LiveRun:
    """One run after another, each from `begin` to `end`, at the pace of a clock.

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

    def __init__(
        self,
        consumers: Sequence[Consumer],
        clock: Callable[[], float],
        stopping: threading.Event,
        playing: bool,
        hold_starts: bool,
    ):
        """`stopping`: set when nothing may move any more; `hold_starts` as for the runner."""
        self._consumers = list(consumers)
        self.number = 0
        self.events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self.dropped = 0
        """Samples that consumers could not take."""
        self.pacing = Pacing()
        self.pacing.playing = playing
        self.steps_left = 0
        """Single steps asked for and not yet done."""
        self._pace_warning = self._accuracy_warning = ""
        self._model_level = 0
        self._clock, self._stopping, self._hold_starts = clock, stopping, hold_starts
        self._block = 1
        """Ticks of the next block."""
        self._runs = RunRate()
        self._frame_end = float("inf")
        self._changed_at = float("-inf")

    def open_frame(self) -> None:
        """Begin a frame and its time budget."""
        self._frame_end = self._clock() + FRAME_BUDGET

    @property
    def may_go_on(self) -> bool:
        """Whether the frame has time left and the run goes on."""
        return not (self.world.status.failed or self._stopping.is_set()) and self._clock() <= self._frame_end

    @property
    def is_busy(self) -> bool:
        """Whether time passes, or steps are left."""
        return self.pacing.runs or self.steps_left > 0

    @property
    def new_run_allowed(self) -> bool:
        """Whether another run may begin now."""
        return self._runs.allowed(self._clock())

    def begin(self, world: World, name: str, time_before: float | None = None) -> None:
        """Make `world` the current run, and send its start and present sample to the consumers.

        `time_before`: time of the run that a change replaces; the pace then stays, and only the first of several such runs waits
        to be released.
        """
        wall, waited = self._clock(), self.pacing.waiting
        dragged = time_before is not None and wall - self._changed_at < DRAG_PAUSE
        if time_before is not None:
            self._changed_at = wall
        self.steps_left = 0
        self.pacing.waiting = self._hold_starts and world.tick == 0 and not dragged
        self._block = 1  # Another world has another cost.
        self._runs.note(wall)
        self.world, self.name, self.start_time = world, name, world.time
        self.number += 1
        self.dropped, self._pace_warning, self._accuracy_warning = 0, "", world.accuracy_warning
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
        if time_before is None or waited or self.pacing.waiting:
            self.restart()
        else:
            self.pacing.pass_on(time_before, world.time)
        if world.status.failed:
            self._fail()

    def end(self, status: Status) -> None:
        """Tell the consumers how the run ended."""
        for consumer in self._consumers:
            consumer.end_run(self.number, status)

    def final_status(self) -> Status:
        """The status of the run if it ends now."""
        return end_status(self.world, f"Ended at t = {self.world.time:.3f} s.")

    def restart(self) -> None:
        """Let the target line begin at the world's time."""
        self.pacing.restart(self._clock(), self.world.time)

    def take_on_change(self) -> None:
        """Follow a change of the world at this instant: the drawn state and the cost of a tick change, no sample is added."""
        self._block = 1
        self.latest = self.world.observe()
        self.checkpoints.note(self.world)
        self._announce_pace()

    def release(self) -> None:
        """Start a run that waits at its first instant."""
        if self.pacing.waiting:
            self.pacing.waiting = False
            self.restart()

    def play(self, playing: bool) -> None:
        """Play or pause. Raises `FlexlabError` for a run that has stopped."""
        if playing:
            self._check_goes_on()
        self.steps_left = 0
        if self.pacing.playing or not playing:
            self.pacing.waiting = False  # Pressing play on a run that only waits releases it.
        self.pacing.playing = playing
        self.restart()

    def set_speed(self, speed: float) -> None:
        """Set the ratio of simulated to wall time. Raises `FlexlabError` outside the allowed range."""
        if not SLOWEST <= speed <= FASTEST:
            raise FlexlabError(
                f"Speed = {number_text(speed)} is outside 1/256 to {number_text(FASTEST)} times real time: choose within it."
            )
        wall = self._clock()
        time_now = min(self.pacing.target(wall), self.world.time + TICK)
        self.pacing.speed = speed
        self.pacing.restart(wall, time_now)

    def ask_for_steps(self, ticks: int) -> None:
        """Pause, and request a number of single steps. Raises `FlexlabError` for too many, or for a run that has stopped."""
        self._check_goes_on()
        if not 1 <= ticks <= MOST_STEPS:
            raise FlexlabError(f"Steps = {ticks} is outside 1 to {MOST_STEPS}: choose within it.")
        self.pacing.playing = self.pacing.waiting = False
        self.steps_left = ticks

    def work_off_steps(self) -> None:
        """Do the single steps that are left, as many as fit into the frame."""
        while self.steps_left and self.may_go_on:
            self.steps_left -= self.advance(self.steps_left)
        if self.world.status.failed:
            self.steps_left = 0
        self.restart()

    def advance(self, most: int) -> int:
        """Move by a block of up to `most` ticks, hand out the samples, report new warnings; returns the ticks done."""
        begun = self._clock()
        rows = self.world.advance_rows(min(most, self._block))
        seconds, ticks = self._clock() - begun, len(rows)
        if ticks > 0:
            affordable = int(BLOCK_TIME * ticks / seconds) if seconds > 0 else LARGEST_BLOCK
            self._block = max(1, min(affordable, ticks * GROWTH, LARGEST_BLOCK))
        self._hand_out(rows, self.pacing.actual_speed())
        warning, before = self.world.accuracy_warning, self._accuracy_warning
        if warning and warning != before:
            self.say(warning, "warning")
        self._accuracy_warning = warning
        beyond = self.world.model_warning
        if beyond.level > self._model_level:
            self.say(beyond.text, "warning")
        self._model_level = beyond.level
        self._announce_pace()
        if self.world.status.failed:
            self._fail()
        return ticks

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

    def snapshot(self, wall: float, answered: int) -> Snapshot:
        """The snapshot at `wall`, s; `answered` as in a `Snapshot`."""
        world, latest = self.world, self.latest
        # The picture is one tick late, so that in slow motion there is always a sample on either side.
        fraction = (self.pacing.target(wall) - float(latest.time[0])) / TICK if self.pacing.runs else 1.0
        return Snapshot(
            run_number=self.number,
            name=self.name,
            scenario=world.scenario,
            status=world.status,
            playing=self.pacing.playing,
            steps_left=self.steps_left,
            latest=latest,
            display=interpolate(self.previous, latest, min(max(fraction, 0.0), 1.0)),
            target_speed=self.pacing.speed,
            actual_speed=self.pacing.actual_speed(),
            too_slow=self.pacing.too_slow(wall),
            dropped_samples=self.dropped,
            first_frequency=world.first_frequency,
            events=tuple(self.events),
            start_time=self.start_time,
            waiting=self.pacing.waiting,
            accuracy_warning=world.accuracy_warning,
            model_warning=world.model_warning.text,
            pace_warning=self._pace_warning,
            answered=answered,
        )

    def _check_goes_on(self) -> None:
        if self.world.status.failed:
            raise FlexlabError(f"This run has stopped: {self.world.status.text} Reset, or load another preset.")

    def _fail(self) -> None:
        self.pacing.playing = False
        self.say(self.world.status.text, "error")

    def _announce_pace(self) -> None:
        """Report once that the run is slower than real time, before anybody waits for it."""
        warning, before = self.world.pace_warning, self._pace_warning
        if warning and not before:
            self.say(warning, "warning")
        self._pace_warning = warning

    def _hand_out(self, rows: np.ndarray, speed: float) -> None:
        if len(rows) == 0:
            return
        self.history.append(rows)
        self.checkpoints.follow(self.world)
        samples = self.world.to_samples(rows)
        self.previous = samples.slice(len(rows) - 2, len(rows) - 1) if len(rows) > 1 else self.latest
        self.latest = samples.slice(len(rows) - 1, len(rows))
        for consumer in self._consumers:
            self.dropped += consumer.take_samples(self.number, samples, speed)
