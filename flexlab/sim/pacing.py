"""How simulation time follows wall time: a target line, a budget per frame, and a backlog that is dropped, not chased."""

from collections import deque

from flexlab.sim.snapshot import TICK

SLOWEST, FASTEST = 1 / 256, 4.0
"""Allowed simulated seconds per wall second."""

BACKLOG_LIMIT = 0.15
"""Wall seconds that the simulation may lag behind its target before the lag is given up: a lag that a person notices."""

SPEED_WINDOW = 1.0
"""Wall seconds over which the actual speed is measured."""


class Pacing:
    """Target simulation time as a function of wall time, both in s. Not thread-safe: belongs to the runner."""

    def __init__(self, speed: float = 1.0):
        self.speed = speed
        self.playing = False
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

    def target(self, wall: float) -> float:
        """Simulation time that should be reached at `wall`."""
        return self._origin + (wall - self._wall) * self.speed if self.playing else self._origin

    def due_ticks(self, wall: float, tick: int) -> int:
        """Whole ticks to advance now; drops the backlog beyond `BACKLOG_LIMIT`."""
        if not self.playing:
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
        """Simulated seconds per wall second over the last second; 0 while paused."""
        if not self.playing or len(self._history) < 2:
            return 0.0
        (first_wall, first_time), (last_wall, last_time) = self._history[0], self._history[-1]
        return (last_time - first_time) / (last_wall - first_wall) if last_wall > first_wall else 0.0

    def too_slow(self, wall: float) -> bool:
        """Whether backlog was dropped within the last second."""
        return wall - self._dropped_at < SPEED_WINDOW
