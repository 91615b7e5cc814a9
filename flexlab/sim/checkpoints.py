"""States of the last minute of the run that is going on, from which any instant of it is computed again."""

import threading
from collections import deque
from dataclasses import dataclass

from flexlab.errors import StudyError
from flexlab.scenario import Scenario
from flexlab.sim.assembly import Assembly
from flexlab.sim.history import HISTORY_SECONDS
from flexlab.sim.snapshot import TICK
from flexlab.sim.world import World
from flexlab.sim.world_state import WorldState

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
