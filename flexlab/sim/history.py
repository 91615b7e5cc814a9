"""The last minute of a run: its samples at full rate, and states from which any instant can be computed again."""

import threading
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexlab.errors import StudyError
from flexlab.scenario import Scenario
from flexlab.signal import Signal
from flexlab.sim import samples
from flexlab.sim.assembly import Assembly
from flexlab.sim.samples import Samples, WorldState
from flexlab.sim.snapshot import TICK
from flexlab.sim.world import World
from flexlab.text import number_text

HISTORY_SECONDS = 60.0
"""How far a person can look back, s; longer than any window of the plots."""


class History:
    """A ring buffer of sample rows; written by the runner, read by any thread."""

    def __init__(self, row_length: int, arm_count: int, own: Sequence[Signal] = ()):
        """`own`: the law's own signals, at the ends of the rows."""
        self._rows = np.zeros((int(HISTORY_SECONDS / TICK) + 1, row_length))
        self._arm_count, self._own = arm_count, tuple(own)
        self._written = 0
        self._lock = threading.Lock()

    def append(self, rows: np.ndarray) -> None:
        """Add rows (N, row length); the newest are kept if not all fit."""
        size = len(self._rows)
        rows = rows[-size:]
        with self._lock:
            start = self._written % size
            first = min(len(rows), size - start)
            self._rows[start : start + first] = rows[:first]
            self._rows[: len(rows) - first] = rows[first:]
            self._written += len(rows)

    def recent(self, seconds: float, ago: int = 0) -> Samples:
        """A copy of the last `seconds`, oldest first, as they were `ago` samples earlier (as far as the ring goes back)."""
        size = len(self._rows)
        with self._lock:
            kept = min(size, self._written)
            ago = min(ago, max(kept - 1, 0))
            count = min(max(round(seconds / TICK), 0) + 1, kept - ago)
            start = (self._written - ago - count) % size
            first = min(count, size - start)
            rows = np.concatenate([self._rows[start : start + first], self._rows[: count - first]])
        return samples.rows_to_samples(rows, self._arm_count, self._own)


PERIOD_TICKS = 250
"""Ticks between two states if no command comes: few enough that even a law in Python computes them in a moment."""
MOST = 1000
"""Largest number of states that are kept: dragging a slider for a minute makes no more."""


@dataclass(frozen=True)
class Checkpoint:
    """A state of the run; no command took effect between it and the next one."""

    assembly: Assembly
    first_frequency: float
    """As `World.first_frequency`, Hz."""
    state: WorldState

    @property
    def scenario(self) -> Scenario:
        """The scenario that was in motion."""
        return self.assembly.scenario


class Checkpoints:
    """The checkpoints of a run; written by the runner, read by any thread."""

    def __init__(self, world: World):
        """Begin with the first state of a run."""
        self._kept: deque[Checkpoint] = deque()
        self._lock = threading.Lock()
        self.note(world)

    def note(self, world: World) -> None:
        """Keep the world's state after a command; if several commands come at one instant, after the last."""
        here = Checkpoint(world.assembly, world.first_frequency, world.state())
        with self._lock:
            if self._kept and self._kept[-1].state.tick == here.state.tick:
                self._kept.pop()
            self._kept.append(here)
            oldest = here.state.tick - round(HISTORY_SECONDS / TICK)
            while len(self._kept) > MOST or (len(self._kept) > 1 and self._kept[1].state.tick <= oldest):
                self._kept.popleft()

    def follow(self, world: World) -> None:
        """Keep the world's state every `PERIOD_TICKS`."""
        if world.tick - self._kept[-1].state.tick >= PERIOD_TICKS:
            self.note(world)

    def before(self, tick: int) -> Checkpoint:
        """The newest checkpoint at or before `tick`; the oldest if there is none."""
        with self._lock:
            return next((one for one in reversed(self._kept) if one.state.tick <= tick), self._kept[0])


def state_from(checkpoint: Checkpoint, tick: int) -> WorldState:
    """The state at `tick`, at most `PERIOD_TICKS` after the checkpoint. Raises `StudyError` if the run does not reach it."""
    world = World(checkpoint.scenario, TICK, (checkpoint.assembly,))
    world.restore(checkpoint.state)
    world.advance_rows(tick - world.tick)
    if world.tick != tick:
        raise StudyError(f"The run cannot go on from t = {number_text(tick * TICK)} s: {world.status.text}")
    return world.state()
