"""How simulation time follows wall time: a target line, a budget per frame, and a backlog that is dropped, not chased."""

from collections import deque

from flexlab.sim.snapshot import TICK

SLOWEST, FASTEST = 1 / 256, 4.0
"""Allowed simulated seconds per wall second."""

BACKLOG_LIMIT = 0.15
"""Wall seconds that the simulation may lag behind its target before the lag is given up: a lag that a person notices."""

BLOCK_TIME, LARGEST_BLOCK, GROWTH = 0.01, 64, 4
"""Wall seconds that a block of ticks may take between two looks at the commands, its most ticks, and how much longer than
the one before it may be: what a tick costs is not known before one is done."""

RUNS_AT_ONCE, RUN_PERIOD = 60, 1.0
"""New runs that may begin one right after another, and wall seconds after which one more may: three seconds of dragging the
number of elements, but no storm that fills a folder."""

SPEED_WINDOW = 1.0
"""Wall seconds over which the actual speed is measured."""


class Pacing:
    """Target simulation time as a function of wall time, both in s. Not thread-safe: belongs to the simulation thread."""

    def __init__(self, speed: float = 1.0):
        self.speed = speed
        self.playing = False
        self.waiting = False
        """Whether time stands, although it is to run, until the run is released."""
        self._wall = 0.0
        self._origin = 0.0
        self._history: deque[tuple[float, float]] = deque()
        self._dropped_at = float("-inf")

    def anchor(self, wall: float, time: float) -> None:
        """Let the target line pass through (wall, time)."""
        self._wall, self._origin = wall, time

    def restart(self, wall: float, time: float) -> None:
        """Anchor, and forget what was measured before."""
        self.anchor(wall, time)
        self._history.clear()

    def pass_on(self, time_before: float, time: float) -> None:
        """Let a world that stands at `time` go on for one that stood at `time_before`: what was due still is."""
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
        """Remember where the simulation stood at `wall`, for `actual_speed`."""
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


class BlockSize:
    """How many ticks to advance at once, from what the ticks before cost."""

    def __init__(self) -> None:
        self._next = 1

    def forget(self) -> None:
        """Another world, another cost: begin with one tick."""
        self._next = 1

    def ticks(self, most: int) -> int:
        """Ticks of the next block."""
        return min(most, self._next)

    def note(self, ticks: int, seconds: float) -> None:
        """Remember that `ticks` took `seconds` of wall time."""
        if ticks > 0:
            affordable = int(BLOCK_TIME * ticks / seconds) if seconds > 0 else LARGEST_BLOCK
            self._next = max(1, min(affordable, ticks * GROWTH, LARGEST_BLOCK))


class RunRate:
    """How often a new run may begin: a bucket of `RUNS_AT_ONCE` that gains one every `RUN_PERIOD`."""

    def __init__(self) -> None:
        self._left, self._at = float(RUNS_AT_ONCE), 0.0

    def allowed(self, wall: float) -> bool:
        """Whether one may begin at `wall`, s."""
        return self._refilled(wall) >= 1

    def note(self, wall: float) -> None:
        """One began."""
        self._left, self._at = self._refilled(wall) - 1, wall

    def _refilled(self, wall: float) -> float:
        return min(RUNS_AT_ONCE, self._left + max(0.0, wall - self._at) / RUN_PERIOD)
