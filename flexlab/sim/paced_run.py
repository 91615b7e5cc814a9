"""The live run as a clock drives it: how far it moves in a frame, single steps, speed, and runs that wait to be released."""

import threading
from collections.abc import Callable, Sequence

from flexlab.errors import FlexlabError
from flexlab.sim.command_queue import MOST_STEPS
from flexlab.sim.consumer import Consumer
from flexlab.sim.interpolation import interpolate
from flexlab.sim.live_run import LiveRun
from flexlab.sim.pacing import FASTEST, SLOWEST, BlockSize, Pacing, RunRate
from flexlab.sim.snapshot import TICK, Snapshot
from flexlab.sim.world import World

FRAME_BUDGET = 0.03
"""Wall seconds after which a round publishes what there is and leaves the rest to the next: a picture every 50 ms."""

DRAG_PAUSE = 0.5
"""Wall seconds after a change that began a run within which another such change is one more value of a dragged slider: its run
waits for nobody."""


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
        """`stopping`: set when nothing is to move any more; `hold_starts` as for the runner."""
        self.live = LiveRun(consumers)
        self.pacing = Pacing()
        self.pacing.playing = playing
        self.steps_left = 0
        """Single steps that were asked for and are still to be done."""
        self._clock, self._stopping, self._hold_starts = clock, stopping, hold_starts
        self._block, self._runs = BlockSize(), RunRate()
        self._frame_end = float("inf")
        self._changed_at = float("-inf")

    def open_frame(self) -> None:
        """A frame's time begins."""
        self._frame_end = self._clock() + FRAME_BUDGET

    @property
    def may_go_on(self) -> bool:
        """Whether the frame has time left, and the run as well."""
        return not (self.live.world.status.failed or self._stopping.is_set()) and self._clock() <= self._frame_end

    @property
    def is_busy(self) -> bool:
        """Whether time passes, or is to pass."""
        return self.pacing.runs or self.steps_left > 0

    @property
    def new_run_allowed(self) -> bool:
        """Whether another run may begin now."""
        return self._runs.allowed(self._clock())

    def begin(self, world: World, name: str, time_before: float | None = None) -> None:
        """Make `world` the current run.

        `time_before`: where the run stood that a change made it of; time then passes as it did, and only the first of several
        such changes is waited for.
        """
        wall, waited = self._clock(), self.pacing.waiting
        dragged = time_before is not None and wall - self._changed_at < DRAG_PAUSE
        if time_before is not None:
            self._changed_at = wall
        self.steps_left = 0
        self.pacing.waiting = self._hold_starts and world.tick == 0 and not dragged
        self._block.forget()
        self._runs.note(wall)
        self.live.begin(world, name)
        if time_before is None or waited or self.pacing.waiting:
            self.restart()
        else:
            self.pacing.pass_on(time_before, world.time)
        if world.status.failed:
            self._fail()

    def restart(self) -> None:
        """Let time go on from where the world is."""
        self.pacing.restart(self._clock(), self.live.world.time)

    def take_on_change(self) -> None:
        """The world has changed at this instant, and with it what a tick costs."""
        self._block.forget()
        self.live.take_on_change()

    def release(self) -> None:
        """Let a run go on that waits at its first instant."""
        if self.pacing.waiting:
            self.pacing.waiting = False
            self.restart()

    def play(self, playing: bool) -> None:
        """Let time pass or stand. Raises `FlexlabError` for a run that has stopped."""
        if playing and self.live.world.status.failed:
            raise FlexlabError(f"This run has stopped: {self.live.world.status.text} Reset, or load another preset.")
        self.steps_left = 0
        if self.pacing.playing or not playing:
            self.pacing.waiting = False  # Who presses play on a run that only waits does not want to wait.
        self.pacing.playing = playing
        self.restart()

    def set_speed(self, speed: float) -> None:
        """Simulated per wall time. Raises `FlexlabError` outside the allowed range."""
        if not SLOWEST <= speed <= FASTEST:
            raise FlexlabError(f"Speed = {speed:g} is outside 1/256 to {FASTEST:g} times real time: choose within it.")
        wall = self._clock()
        time_now = min(self.pacing.target(wall), self.live.world.time + TICK)
        self.pacing.speed = speed
        self.pacing.restart(wall, time_now)

    def ask_for_steps(self, ticks: int) -> None:
        """Let time stand, but for so many single steps. Raises `FlexlabError` for too many."""
        if not 1 <= ticks <= MOST_STEPS:
            raise FlexlabError(f"Steps = {ticks} is outside 1 to {MOST_STEPS}: choose within it.")
        self.pacing.playing = self.pacing.waiting = False
        self.steps_left = ticks

    def work_off_steps(self) -> None:
        """Do single steps that are left, as far as the frame's time goes; the next frame goes on."""
        while self.steps_left and self.may_go_on:
            self.steps_left -= self.advance(self.steps_left)
        if self.live.world.status.failed:
            self.steps_left = 0
        self.restart()

    def advance(self, most: int) -> int:
        """Move by a block of up to `most` ticks, as long as commands may wait; returns the ticks done."""
        ticks, begun = self._block.ticks(most), self._clock()
        rows = self.live.world.advance_rows(ticks)
        self._block.note(len(rows), self._clock() - begun)
        self.live.take_rows(rows, self.pacing.actual_speed())
        if self.live.world.status.failed:
            self._fail()
        return len(rows)

    def snapshot(self, wall: float, answered: int) -> Snapshot:
        """What is to be shown at `wall`, s; `answered` as in a `Snapshot`."""
        run, world, latest = self.live, self.live.world, self.live.latest
        # Drawn one tick late, so that in slow motion there is always a sample on either side to draw between.
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
            axial_warning=world.axial_warning.text,
            pace_warning=run.pace_warning,
            answered=answered,
        )

    def _fail(self) -> None:
        self.pacing.playing = False
        self.live.say(self.live.world.status.text, "error")
