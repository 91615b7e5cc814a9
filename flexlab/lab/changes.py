"""Undo and redo, and changes that run a person's own code on a separate thread."""

import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Self

from flexlab.errors import FlexlabError, telling
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.samples import Origin

LONGEST_HISTORY = 200
"""Most steps that can be undone."""
ONE_GESTURE = 1.0
"""Changes of the same settings within this time, wall s, are one step: a slider sends twenty a second."""
PATH = "trajectory"


@dataclass(frozen=True)
class Settings:
    """One state of the undo history. `baseline`: the preset or file `name`, unchanged, that `scenario` came from.

    `origin`: the instant of an earlier run that the run with these settings continued from.
    """

    scenario: Scenario
    name: str
    baseline: Scenario
    origin: Origin | None = None

    @classmethod
    def of_run(cls, scenario: Scenario, name: str, origin: Origin | None) -> Self:
        """Settings of a new run. A run that continues an earlier one is compared with that run's preset."""
        baseline = scenario
        if origin is not None:
            with suppress(FlexlabError):
                baseline = load_preset(name)
        return cls(scenario, name, baseline, origin)


class Undo:
    """The undo history: two stacks of settings."""

    def __init__(self) -> None:
        self._past: list[Settings] = []
        self._future: list[Settings] = []
        self._gesture: tuple[object, float] = (None, 0.0)

    def note(self, before: Settings, gesture: object = None) -> None:
        """Record that a change is about to replace `before`. Equal `gesture`s in quick succession are one step."""
        now = time.monotonic()
        same = gesture is not None and gesture == self._gesture[0] and now - self._gesture[1] < ONE_GESTURE
        self._gesture = (gesture, now)
        self._future.clear()
        if not same:
            self._past = [*self._past[-LONGEST_HISTORY + 1 :], before]

    def renamed(self, old: Settings, new: Settings) -> None:
        """Give the steps with the preset or file of `old` that of `new`, in which the same run goes on."""
        for steps in (self._past, self._future):
            steps[:] = [
                replace(new, scenario=one.scenario) if replace(one, scenario=old.scenario) == old else one
                for one in steps
            ]

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
            # A change that the engine refused had no effect: skip its step.
            if found != present:
                target.append(present)
                return found
        return None


class SlowChanges:
    """Carries out changes one at a time. Changes that arrive meanwhile are merged: the last value of each field counts."""

    def __init__(self, carry_out: Callable[[Mapping[str, Any], "SlowChanges"], None], warn: Callable[[str], None]):
        """`carry_out` gets a change and this object; `warn` gets a sentence about a change that was refused."""
        self._carry_out, self._warn = carry_out, warn
        self._lock = threading.Lock()
        self._waiting: dict[str, Any] = {}
        self.is_busy = False
        """Whether a change is being carried out, so that further ones must wait."""

    def ask(self, changes: Mapping[str, Any]) -> None:
        """Carry out a change on a separate thread. May be called from any thread."""
        with self._lock:
            if f"{PATH}.kind" in changes or PATH in changes:  # Fields of the previous path no longer exist.
                self._waiting = {path: value for path, value in self._waiting.items() if not path.startswith(PATH)}
            self._waiting.update(changes)
            if not self.is_busy:
                self.is_busy = True
                threading.Thread(target=self._work, name="flexlab-own-path", daemon=True).start()

    def _work(self) -> None:
        while True:
            with self._lock:
                changes, self._waiting = self._waiting, {}
                if not changes:
                    self.is_busy = False
                    return
            with telling(self._warn, "This change failed ({}); the simulation goes on."):
                self._carry_out(changes, self)
