"""The way back: settings as they were before each change, and forward again."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from flexlab.scenario import Scenario
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


def changes_towards(present: Scenario, wanted: Scenario) -> dict[str, Any]:
    """Changes by path that make `present` into `wanted`; a new kind stands before its fields."""
    return dict(_changes(present.model_dump(), wanted.model_dump(), ""))


def _changes(present: Any, wanted: dict[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    for name in sorted(wanted, key=lambda name: name != "kind"):
        inner = f"{path}.{name}" if path else name
        old, new = present.get(name), wanted[name]
        if isinstance(old, dict) and isinstance(new, dict):
            if old.get("kind") != new.get("kind"):
                yield f"{inner}.kind", new["kind"]
                old = {"kind": new["kind"]}
            yield from _changes(old, new, inner)
        elif old != new or name not in present:
            yield inner, new
