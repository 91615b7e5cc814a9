"""Commands on their way to the runner: bounded, and merged where a later one makes an earlier one pointless.

A slider sends twenty values a second, a held key thirty resets: what nobody would see is dropped before it costs anything.
What is left is carried out, and recorded, exactly as it stands.
"""

import threading
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from flexlab.errors import FlexlabError
from flexlab.sim.commands import (
    ChangeScenario,
    Command,
    LoadScenario,
    Pause,
    Play,
    Pull,
    Reset,
    SetSpeed,
    StepOnce,
    Tap,
)

MOST_WAITING = 256
"""Commands that may wait: more than the fields of a scenario, so that only a storm of taps or odd names comes so far."""

MOST_STEPS = 100_000
"""Most ticks that one `StepOnce` may ask for (100 s)."""

NEW_RUN_FIELDS = ("payload.length", "payload.element_count", "payload.boundary", "left_arm", "right_arm", "initial")
"""Fields whose change begins a new run: with another machine, or with coordinates of another meaning."""

ON_A_RUN = (ChangeScenario, Pull, Tap, Reset, StepOnce)
"""What a new run makes pointless, or takes over."""


class CommandQueue:
    """Put from any thread, taken by the runner."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[Command] = []
        self._refused = 0
        self._count = 0

    def put(self, command: Command) -> int:
        """Add a command; what it supersedes goes. How many commands have come, with this one."""
        with self._lock:
            self._count += 1
            waiting = with_command(self._waiting, command)
            if len(waiting) > MOST_WAITING:
                self._refused += 1
            else:
                self._waiting = waiting
            return self._count

    @property
    def count(self) -> int:
        """How many commands have come."""
        with self._lock:
            return self._count

    def take(self, new_runs: bool = True) -> list[tuple[Command, ...]]:
        """All that waits, in the groups of `grouped`; with `new_runs` False only what stands before the first new run."""
        with self._lock:
            count = 0
            while count < len(self._waiting) and (new_runs or not begins_run(self._waiting[count])):
                count += 1
            taken, self._waiting = self._waiting[:count], self._waiting[count:]
        return grouped(taken)

    def put_back(self, groups: list[tuple[Command, ...]]) -> None:
        """Let groups that were taken wait again, before all that came since."""
        with self._lock:
            waiting = [command for group in groups for command in group]
            for command in self._waiting:
                waiting = with_command(waiting, command)
            self._waiting = waiting

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits."""
        with self._lock:
            return not self._waiting

    @property
    def has_load(self) -> bool:
        """Whether another scenario waits to be loaded: nothing that is still being prepared matters any more."""
        with self._lock:
            return any(isinstance(command, LoadScenario) for command in self._waiting)

    def refused(self) -> int:
        """How many commands found the queue full since this was last asked."""
        with self._lock:
            count, self._refused = self._refused, 0
            return count


def begins_run(command: Command) -> bool:
    """Whether a command begins a new run, if the scenario allows it."""
    if isinstance(command, ChangeScenario):
        return any(overlap(path, field) for path in command.changes for field in NEW_RUN_FIELDS)
    return isinstance(command, (LoadScenario, Reset))


def _covers(path: str, other: str) -> bool:
    """Whether setting `path` sets all of `other`."""
    return other == path or other.startswith(path + ".")


def overlap(path: str, other: str) -> bool:
    """Whether two dotted paths name something in common."""
    return _covers(path, other) or _covers(other, path)


def with_command(waiting: list[Command], new: Command) -> list[Command]:
    """The commands that are left to carry out when `new` joins those that wait, in order."""
    if isinstance(new, LoadScenario):
        return [*(old for old in waiting if not isinstance(old, (*ON_A_RUN, LoadScenario))), new]
    if isinstance(new, Reset):
        return _with_reset(waiting, new)
    steps_last = waiting[-1] if waiting and isinstance(waiting[-1], StepOnce) else None
    if isinstance(new, StepOnce) and steps_last is not None and min(new.ticks, steps_last.ticks) > 0:
        if new.ticks + steps_last.ticks <= MOST_STEPS:
            return [*waiting[:-1], StepOnce(new.ticks + steps_last.ticks)]
    start = _last(waiting, (LoadScenario, Reset, StepOnce)) + 1
    return [*waiting[:start], *(old for old in waiting[start:] if not _supersedes(new, old)), new]


def _supersedes(new: Command, old: Command) -> bool:
    """Whether `old`, given just before `new`, changes nothing any more."""
    if isinstance(new, ChangeScenario):
        return isinstance(old, ChangeScenario) and all(
            any(_covers(path, earlier) for path in new.changes) for earlier in old.changes
        )
    if isinstance(new, (Play, Pause)):
        return isinstance(old, (Play, Pause))
    return isinstance(new, (Pull, SetSpeed)) and type(old) is type(new)


def _with_reset(waiting: list[Command], new: Reset) -> list[Command]:
    """A reset keeps the changes of the scenario; a run that has not begun begins with them instead of being reset."""
    kept: list[Command] = []
    for old in waiting:  # Changes on either side of what goes may now supersede one another.
        kept = kept if isinstance(old, (Pull, Tap, Reset, StepOnce)) else with_command(kept, old)
    at = _last(kept, (LoadScenario,))
    if at < 0:
        return [*kept, new]
    load, rest = kept[at], kept[at + 1 :]
    assert isinstance(load, LoadScenario)
    changes = merged_changes(old.changes for old in rest if isinstance(old, ChangeScenario))
    try:
        load = replace(load, scenario=load.scenario.replace(changes), origin=None)
    except FlexlabError:
        return [*kept, new]
    return [*kept[:at], load, *(old for old in rest if not isinstance(old, ChangeScenario))]


def _last(commands: list[Command], kinds: tuple[type, ...]) -> int:
    """Index of the last command of these kinds, or -1."""
    return max((at for at, command in enumerate(commands) if isinstance(command, kinds)), default=-1)


def merged_changes(changes: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """One change that does what several do in turn: the last value of a field, in the order of the last values."""
    result: dict[str, Any] = {}
    for change in changes:
        for path, value in change.items():
            result.pop(path, None)
            result[path] = value
    return result


def grouped(commands: Iterable[Command]) -> list[tuple[Command, ...]]:
    """Commands of one frame in groups: the changes between two new runs or steps are one, where the first of them stands."""
    groups: list[tuple[Command, ...]] = []
    place = -1
    for command in commands:
        if isinstance(command, ChangeScenario):
            if place >= 0:
                groups[place] = (*groups[place], command)
                continue
            place = len(groups)
        elif isinstance(command, (LoadScenario, Reset, StepOnce)):
            place = -1
        groups.append((command,))
    return groups
