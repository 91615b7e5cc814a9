"""The last minute of a run: its samples at full rate, and states from which any instant of it is computed again."""

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
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK
from flexlab.sim.world import World
from flexlab.sim.world_state import WorldState

HISTORY_SECONDS = 60.0
"""How far a person can look back, s; longer than any window that plots offer."""


class History:
    """A ring of sample rows; written by the runner, copied out by anyone."""

    def __init__(self, row_length: int, arm_count: int, own: Sequence[Signal] = ()):
        """`own`: the law's own signals, which stand at the rows' ends."""
        self._rows = np.zeros((int(HISTORY_SECONDS / TICK) + 1, row_length))
        self._arm_count, self._own = arm_count, tuple(own)
        self._written = 0
        self._lock = threading.Lock()

    def append(self, rows: np.ndarray, own: Sequence[Signal] = ()) -> None:
        """Add rows (N, row length), at most the ring's size at once. `own`: as of the law that is now at work."""
        size = len(self._rows)
        rows = rows[-size:]
        with self._lock:
            if tuple(own) != self._own:
                self._follow(rows.shape[1], tuple(own))
            start = self._written % size
            first = min(len(rows), size - start)
            self._rows[start : start + first] = rows[:first]
            self._rows[: len(rows) - first] = rows[first:]
            self._written += len(rows)

    def _follow(self, row_length: int, own: tuple[Signal, ...]) -> None:
        """Another law came in: what it shows of itself has no past."""
        shared = row_length - sum(signal.fixed_size for signal in own)
        rows = np.full((len(self._rows), row_length), np.nan)
        rows[:, :shared] = self._rows[:, :shared]
        self._rows, self._own = rows, own

    def recent(self, seconds: float, ago: int = 0) -> Samples:
        """A copy of the last `seconds`, oldest first, as they were `ago` samples earlier (as far as the ring goes back)."""
        size = len(self._rows)
        with self._lock:
            kept = min(size, self._written)
            ago = min(ago, max(kept - 1, 0))
            count = min(max(round(seconds / TICK), 0) + 1, kept - ago)
            start = (self._written - ago - count) % size
            first = min(count, size - start)
            own = self._own
            rows = np.concatenate([self._rows[start : start + first], self._rows[: count - first]])
        return samples.rows_to_samples(rows, self._arm_count, own)


PERIOD_TICKS = 250
"""Ticks from one state to the next where no command comes between: a law in Python is asked so often in a moment."""
MOST = 1000
"""States that are kept: a slider that is dragged for a minute leaves no more."""


@dataclass(frozen=True)
class Checkpoint:
    """Where the run stood once; until the next one no command took effect."""

    scenario: Scenario
    assembly: Assembly
    first_frequency: float
    """As of the world, Hz."""
    state: WorldState


class Checkpoints:
    """Written by the runner, read by anyone."""

    def __init__(self, world: World):
        """Of a run that begins."""
        self._kept: deque[Checkpoint] = deque()
        self._lock = threading.Lock()
        self.note(world)

    def note(self, world: World) -> None:
        """Keep where the world stands, after a command; of several at one instant the last counts."""
        here = Checkpoint(world.scenario, world.assembly, world.first_frequency, world.state())
        with self._lock:
            if self._kept and self._kept[-1].state.tick == here.state.tick:
                self._kept.pop()
            self._kept.append(here)
            oldest = here.state.tick - round(HISTORY_SECONDS / TICK)
            while len(self._kept) > MOST or (len(self._kept) > 1 and self._kept[1].state.tick <= oldest):
                self._kept.popleft()

    def follow(self, world: World) -> None:
        """Keep where the world stands, once in a while."""
        if world.tick - self._kept[-1].state.tick >= PERIOD_TICKS:
            self.note(world)

    def before(self, tick: int) -> Checkpoint:
        """The newest one at or before `tick`; the oldest if there is none."""
        with self._lock:
            found = self._kept[0]
            for one in self._kept:
                if one.state.tick > tick:
                    break
                found = one
        return found


def state_from(checkpoint: Checkpoint, tick: int) -> WorldState:
    """The state at `tick`, at most `PERIOD_TICKS` later. Raises `StudyError` if the run does not come to it."""
    world = World(checkpoint.scenario, TICK, (checkpoint.assembly,))
    world.restore(checkpoint.state)
    world.advance_rows(tick - world.tick)
    if world.tick != tick:
        raise StudyError(f"The run cannot go on from t = {tick * TICK:g} s: {world.status.text}")
    return world.state()
