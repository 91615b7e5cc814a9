"""The live run driven by a clock: ticks per frame, speed, slow motion, single steps, and runs that wait.

Simulation time follows a target line with a budget for each frame; a backlog is dropped, not caught up. In slow motion, states
between two samples are interpolated, so that the picture moves smoothly although samples are a millisecond apart.
"""

import threading
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np

from flexlab.errors import FlexlabError
from flexlab.sim.command_queue import MOST_STEPS
from flexlab.sim.live_run import LiveRun
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK, Consumer, Snapshot
from flexlab.sim.world import World
from flexlab.text import number_text


def interpolate(before: Samples, after: Samples, fraction: float) -> Samples:
    """The state at `fraction` in [0, 1] of the way between two samples (N = 1 each).

    Pose and beam follow cubic Hermite curves through positions and rates, the rest straight lines.
    """
    if fraction >= 1 or len(before) == 0 or before.beam_coordinates.shape != after.beam_coordinates.shape:
        return after
    signals = {}
    earlier, later = before.signals(), after.signals()
    for name, b in later.items():
        a = earlier.get(name, b)
        signals[name] = a + fraction * (b - a)
    span = float(after.time[0] - before.time[0])
    for position, rate in (("pose", "pose_rate"), ("beam_coordinates", "beam_rates")):
        ends = [getattr(sample, name) for sample in (before, after) for name in (position, rate)]
        signals[position] = _hermite(*ends, span, fraction)
    for signal in signals.values():
        signal.flags.writeable = False
    return Samples(**signals)


def _hermite(
    x0: np.ndarray, v0: np.ndarray, x1: np.ndarray, v1: np.ndarray, span: float, fraction: float
) -> np.ndarray:
    f, g = fraction, 1 - fraction
    return g * g * (1 + 2 * f) * x0 + f * f * (1 + 2 * g) * x1 + span * f * g * (g * v0 - f * v1)


SLOWEST, FASTEST = 1 / 256, 4.0
"""Allowed simulated seconds per wall second."""

BACKLOG_LIMIT = 0.15
"""Wall seconds that the simulation may lag behind its target before the backlog is dropped: a lag that a person notices."""

BLOCK_TIME, LARGEST_BLOCK, GROWTH = 0.01, 64, 4
"""Wall seconds that a block of ticks may take, so that commands wait no longer; its most ticks; and how much longer than the one
before it may be: the cost of a tick is unknown before one is done."""

RUNS_AT_ONCE, RUN_PERIOD = 60, 1.0
"""New runs that may begin one right after another, and wall seconds after which one more may: enough for three seconds of
dragging the number of elements, too few to fill a folder."""

SPEED_WINDOW = 1.0
"""Wall seconds over which the actual speed is measured."""


class Pacing:
    """Target simulation time as a function of wall time, both in s. Not thread-safe: belongs to the simulation thread."""

    def __init__(self, speed: float = 1.0):
        self.speed = speed
        self.playing = False
        self.waiting = False
        """Whether time stands until the run is released, although it is to run."""
        self._wall = 0.0
        self._origin = 0.0
        self._history: deque[tuple[float, float]] = deque()
        self._dropped_at = float("-inf")

    def anchor(self, wall: float, time: float) -> None:
        """Make the target line pass through (wall, time)."""
        self._wall, self._origin = wall, time

    def restart(self, wall: float, time: float) -> None:
        """Anchor, and drop earlier measurements of speed."""
        self.anchor(wall, time)
        self._history.clear()

    def pass_on(self, time_before: float, time: float) -> None:
        """Shift the target line for a new world at `time` that replaces one at `time_before`: what was due still is."""
        self._origin += time - time_before
        self._history = deque((wall, past + time - time_before) for wall, past in self._history)

    def target(self, wall: float) -> float:
        """Simulation time that should be reached at `wall`."""
        return self._origin + (wall - self._wall) * self.speed if self.runs else self._origin

    @property
    def runs(self) -> bool:
        """Whether simulation time passes."""
        return self.playing and not self.waiting

    def due_ticks(self, wall: float, tick: int) -> int:
        """Whole ticks to advance now; drops the backlog beyond `BACKLOG_LIMIT`."""
        if not self.runs:
            return 0
        target = self.target(wall)
        due = max(0, int(target / TICK + 1e-6) - tick)
        # Whole ticks only: in slow motion the line runs ahead of the last tick for long without anything being late.
        affordable = max(1, int(BACKLOG_LIMIT * self.speed / TICK))
        if due > affordable:
            due = affordable
            self.anchor(wall, (tick + due) * TICK)
            self._dropped_at = wall
        return due

    def note(self, wall: float, time: float) -> None:
        """Note the simulation time at `wall`, for `actual_speed`."""
        self._history.append((wall, time))
        while len(self._history) > 2 and wall - self._history[1][0] >= SPEED_WINDOW:
            self._history.popleft()

    def actual_speed(self) -> float:
        """Simulated seconds per wall second over the last second; 0 while paused or waiting."""
        if not self.runs or len(self._history) < 2:
            return 0.0
        (first_wall, first_time), (last_wall, last_time) = self._history[0], self._history[-1]
        return (last_time - first_time) / (last_wall - first_wall) if last_wall > first_wall else 0.0

    def too_slow(self, wall: float) -> bool:
        """Whether it plays, and backlog was dropped within the last second."""
        return self.runs and wall - self._dropped_at < SPEED_WINDOW


class RunRate:
    """How often a new run may begin: a bucket of `RUNS_AT_ONCE` that gains one every `RUN_PERIOD`."""

    def __init__(self) -> None:
        self._left, self._at = float(RUNS_AT_ONCE), 0.0

    def allowed(self, wall: float) -> bool:
        """Whether one may begin at `wall`, s."""
        return self._refilled(wall) >= 1

    def note(self, wall: float) -> None:
        """Note that a run began at `wall`, s."""
        self._left, self._at = self._refilled(wall) - 1, wall

    def _refilled(self, wall: float) -> float:
        return min(RUNS_AT_ONCE, self._left + max(0.0, wall - self._at) / RUN_PERIOD)


FRAME_BUDGET = 0.03
"""Wall seconds after which a frame publishes what there is and leaves the rest to the next: a picture every 50 ms."""

DRAG_PAUSE = 0.5
"""Wall seconds within which a second change that begins a run counts as the next value of a dragged slider: its run does not wait
to be released."""


class PacedRun:
    """A `LiveRun` and its pace. Not thread-safe: belongs to the simulation thread."""

    def __init__(
        self,
        consumers: Sequence[Consumer],
        clock: Callable[[], float],
        stopping: threading.Event,
        playing: bool,
        hold_starts: bool,
    ):
        """`stopping`: set when nothing may move any more; `hold_starts` as for the runner."""
        self.live = LiveRun(consumers)
        self.pacing = Pacing()
        self.pacing.playing = playing
        self.steps_left = 0
        """Single steps asked for and not yet done."""
        self._clock, self._stopping, self._hold_starts = clock, stopping, hold_starts
        self._block = 1
        """Ticks of the next block."""
        self._runs = RunRate()
        self._frame_end = float("inf")
        self._changed_at = float("-inf")

    def open_frame(self) -> None:
        """Begin a frame."""
        self._frame_end = self._clock() + FRAME_BUDGET

    @property
    def may_go_on(self) -> bool:
        """Whether the frame has time left and the run goes on."""
        return not (self.live.world.status.failed or self._stopping.is_set()) and self._clock() <= self._frame_end

    @property
    def is_busy(self) -> bool:
        """Whether time passes, or steps are left."""
        return self.pacing.runs or self.steps_left > 0

    @property
    def new_run_allowed(self) -> bool:
        """Whether another run may begin now."""
        return self._runs.allowed(self._clock())

    def begin(self, world: World, name: str, time_before: float | None = None) -> None:
        """Make `world` the current run.

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
        self.live.begin(world, name)
        if time_before is None or waited or self.pacing.waiting:
            self.restart()
        else:
            self.pacing.pass_on(time_before, world.time)
        if world.status.failed:
            self._fail()

    def restart(self) -> None:
        """Let the target line begin at the world's time."""
        self.pacing.restart(self._clock(), self.live.world.time)

    def take_on_change(self) -> None:
        """Follow a change of the world at this instant, which may change the cost of a tick."""
        self._block = 1
        self.live.take_on_change()

    def release(self) -> None:
        """Start a run that waits at its first instant."""
        if self.pacing.waiting:
            self.pacing.waiting = False
            self.restart()

    def play(self, playing: bool) -> None:
        """Play or pause. Raises `FlexlabError` for a run that has stopped."""
        if playing and self.live.world.status.failed:
            raise FlexlabError(f"This run has stopped: {self.live.world.status.text} Reset, or load another preset.")
        self.steps_left = 0
        if self.pacing.playing or not playing:
            self.pacing.waiting = False  # Pressing play on a run that only waits releases it.
        self.pacing.playing = playing
        self.restart()

    def set_speed(self, speed: float) -> None:
        """Set simulated over wall time. Raises `FlexlabError` outside the allowed range."""
        if not SLOWEST <= speed <= FASTEST:
            raise FlexlabError(
                f"Speed = {number_text(speed)} is outside 1/256 to {number_text(FASTEST)} times real time: choose within it."
            )
        wall = self._clock()
        time_now = min(self.pacing.target(wall), self.live.world.time + TICK)
        self.pacing.speed = speed
        self.pacing.restart(wall, time_now)

    def ask_for_steps(self, ticks: int) -> None:
        """Pause, and do so many single steps. Raises `FlexlabError` for too many."""
        if not 1 <= ticks <= MOST_STEPS:
            raise FlexlabError(f"Steps = {ticks} is outside 1 to {MOST_STEPS}: choose within it.")
        self.pacing.playing = self.pacing.waiting = False
        self.steps_left = ticks

    def work_off_steps(self) -> None:
        """Do the single steps that are left, as many as fit into the frame."""
        while self.steps_left and self.may_go_on:
            self.steps_left -= self.advance(self.steps_left)
        if self.live.world.status.failed:
            self.steps_left = 0
        self.restart()

    def advance(self, most: int) -> int:
        """Move by a block of up to `most` ticks; returns the ticks done."""
        begun = self._clock()
        rows = self.live.world.advance_rows(min(most, self._block))
        seconds, ticks = self._clock() - begun, len(rows)
        if ticks > 0:
            affordable = int(BLOCK_TIME * ticks / seconds) if seconds > 0 else LARGEST_BLOCK
            self._block = max(1, min(affordable, ticks * GROWTH, LARGEST_BLOCK))
        self.live.take_rows(rows, self.pacing.actual_speed())
        if self.live.world.status.failed:
            self._fail()
        return ticks

    def snapshot(self, wall: float, answered: int) -> Snapshot:
        """The snapshot at `wall`, s; `answered` as in a `Snapshot`."""
        run, world, latest = self.live, self.live.world, self.live.latest
        # One tick late, so that in slow motion there is always a sample on either side.
        fraction = (self.pacing.target(wall) - float(latest.time[0])) / TICK if self.pacing.runs else 1.0
        return Snapshot(
            run_number=run.number,
            name=run.name,
            scenario=world.scenario,
            status=world.status,
            playing=self.pacing.playing,
            latest=latest,
            display=interpolate(run.previous, latest, min(max(fraction, 0.0), 1.0)),
            target_speed=self.pacing.speed,
            actual_speed=self.pacing.actual_speed(),
            too_slow=self.pacing.too_slow(wall),
            dropped_samples=run.dropped,
            first_frequency=world.first_frequency,
            events=tuple(run.events),
            start_time=run.start_time,
            waiting=self.pacing.waiting,
            accuracy_warning=world.accuracy_warning,
            model_warning=world.model_warning.text,
            pace_warning=run.pace_warning,
            answered=answered,
        )

    def _fail(self) -> None:
        self.pacing.playing = False
        self.live.say(self.live.world.status.text, "error")
