"""The pace of a live run: where simulation time should be, how often a run may begin, and pictures between two samples.

In slow motion, states between two samples are interpolated, so that the picture moves smoothly although samples are a
millisecond apart.
"""

from collections import deque

import numpy as np

from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK


def interpolate(before: Samples, after: Samples, fraction: float) -> Samples:
    """The state at `fraction` in [0, 1] of the way between two samples (N = 1 each).

    Pose and beam follow cubic Hermite curves through positions and rates, all else straight lines; a joint turns the short way.
    """
    if fraction >= 1 or len(before) == 0 or before.beam_coordinates.shape != after.beam_coordinates.shape:
        return after
    signals = {}
    earlier, later = before.signals(), after.signals()
    for name, b in later.items():
        a = earlier.get(name, b)
        change = b - a
        if name == "joint_angle":
            change -= 2 * np.pi * np.rint(change / (2 * np.pi))  # An angle that passes π goes on at −π.
        signals[name] = a + fraction * change
    span = float(after.time[0] - before.time[0])
    for position, rate in (("pose", "pose_rate"), ("beam_coordinates", "beam_rates")):
        ends = [getattr(sample, name) for sample in (before, after) for name in (position, rate)]
        signals[position] = _hermite(*ends, span, fraction)
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
        """Whether time stands still until the run is released, although it is set to play."""
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
        # Count whole ticks only: in slow motion, the target is ahead of the last tick for long without anything being late.
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
        """Whether time passes, and a backlog was dropped within the last second."""
        return self.runs and wall - self._dropped_at < SPEED_WINDOW


class RunRate:
    """The limit on new runs: a token bucket of `RUNS_AT_ONCE` that gains one every `RUN_PERIOD`."""

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
