"""The way back: settings as they were before each change, and forward again."""

import time
from dataclasses import dataclass

from flexlab.scenario import Scenario
from flexlab.scenario.differences import changes_towards as changes_towards
from flexlab.sim.world_state import Origin

LONGEST_HISTORY = 200
"""Steps that can be undone."""
ONE_GESTURE = 1.0
"""Changes of the same settings within this time, wall seconds, are one step: a slider sends twenty a second."""


@dataclass(frozen=True)
class Settings:
    """What can be gone back to. `baseline`: the preset or file, unchanged, that `scenario` came from as `name`.

    `origin`: the instant of an earlier run from which the run went on that had these settings.
    """

    scenario: Scenario
    name: str
    baseline: Scenario
    origin: Origin | None = None


class Undo:
    """Two stacks of settings."""

    def __init__(self) -> None:
        self._past: list[Settings] = []
        self._future: list[Settings] = []
        self._gesture: tuple[object, float] = (None, 0.0)

    def note(self, before: Settings, gesture: object = None) -> None:
        """A change is about to replace `before`. Equal `gesture`s in quick succession are one step."""
        now = time.monotonic()
        same = gesture is not None and gesture == self._gesture[0] and now - self._gesture[1] < ONE_GESTURE
        self._gesture = (gesture, now)
        self._future.clear()
        if not same:
            self._past = [*self._past[-LONGEST_HISTORY + 1 :], before]

    def back(self, present: Settings) -> Settings | None:
        """The settings one step back, or None if there is no step."""
        return self._move(present, self._past, self._future)

    def forward(self, present: Settings) -> Settings | None:
        """The settings one step forward again, or None."""
        return self._move(present, self._future, self._past)

    def _move(self, present: Settings, source: list[Settings], target: list[Settings]) -> Settings | None:
        self._gesture = (None, 0.0)
        while source:
            found = source.pop()
            # A change that the engine refused left no trace: its step is passed over.
            if found != present:
                target.append(present)
                return found
        return None
