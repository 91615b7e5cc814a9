"""Commands on their way to the runner: bounded, without those that a later one makes pointless, and prepared.

A slider sends twenty values a second, a held key thirty resets: commands whose effect nobody would see are dropped.
The others are carried out and recorded exactly as they are. Slow derivations for them (modes and matrix functions of fine
meshes) run beside the world, on a thread of their own.
"""

import threading
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

from flexlab.errors import FlexlabError
from flexlab.scenario import Scenario
from flexlab.sim.assembly import Assembly
from flexlab.sim.commands import (
    MESH_FIELDS,
    RESTART_FIELDS,
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
from flexlab.sim.snapshot import TICK
from flexlab.sim.step_trial import build_assembly

MOST_WAITING = 256
"""Largest number of waiting commands: more than a scenario has fields, so that only a flood of taps or odd names reaches it."""
MOST_STEPS = 100_000
"""Largest number of ticks of one `StepOnce` (100 s)."""
ON_A_RUN = (ChangeScenario, Pull, Tap, Reset, StepOnce)
"""Commands that a new run makes pointless, or includes."""


class CommandQueue:
    """The queue of commands, filled from any thread and emptied by the runner."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[Command] = []
        self._refused = 0
        self._count = 0

    def put(self, command: Command) -> int:
        """Add a command and drop those that it supersedes; returns the number of commands so far."""
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
        """Number of commands so far."""
        with self._lock:
            return self._count

    def take(self, new_runs: bool = True) -> list[tuple[Command, ...]]:
        """Take all waiting commands, `grouped`; with `new_runs` False only those before the first that begins a run."""
        with self._lock:
            count = 0
            while count < len(self._waiting) and (new_runs or not begins_run(self._waiting[count])):
                count += 1
            taken, self._waiting = self._waiting[:count], self._waiting[count:]
        return grouped(taken)

    def put_back(self, groups: list[tuple[Command, ...]]) -> None:
        """Return groups that were taken to the queue, before all commands that came since."""
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
        """Whether another scenario waits to be loaded, so that nothing in preparation matters any more."""
        with self._lock:
            return any(isinstance(command, LoadScenario) for command in self._waiting)

    def refused(self) -> int:
        """Number of commands refused by a full queue since the last call."""
        with self._lock:
            count, self._refused = self._refused, 0
            return count


def begins_run(command: Command) -> bool:
    """Whether a command begins a new run, if the scenario allows it."""
    if isinstance(command, ChangeScenario):
        return any(overlap(path, field) for path in command.changes for field in (*RESTART_FIELDS, *MESH_FIELDS))
    return isinstance(command, (LoadScenario, Reset))


def _covers(path: str, other: str) -> bool:
    """Whether setting `path` sets all of `other`."""
    return other == path or other.startswith(path + ".")


def overlap(path: str, other: str) -> bool:
    """Whether two dotted paths name something in common."""
    return _covers(path, other) or _covers(other, path)


def with_command(waiting: list[Command], new: Command) -> list[Command]:
    """The waiting commands after `new` has been added, in order."""
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
    """Whether `old`, just before `new`, has no effect any more."""
    if isinstance(new, ChangeScenario):
        return isinstance(old, ChangeScenario) and all(
            any(_covers(path, earlier) for path in new.changes) for earlier in old.changes
        )
    if isinstance(new, (Play, Pause)):
        return isinstance(old, (Play, Pause))
    return isinstance(new, (Pull, SetSpeed)) and type(old) is type(new)


def _with_reset(waiting: list[Command], new: Reset) -> list[Command]:
    """Add a reset. Changes of the scenario stay; a run that is still to be loaded begins with them instead of being reset."""
    kept: list[Command] = []
    for old in waiting:  # Changes on either side of a dropped command may now supersede one another.
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
    """One change equal to several in turn: each field's last value, in the order of these values."""
    result: dict[str, Any] = {}
    for change in changes:
        for path, value in change.items():
            result.pop(path, None)
            result[path] = value
    return result


def grouped(commands: Iterable[Command]) -> list[tuple[Command, ...]]:
    """Group commands of one frame: all changes between two new runs or steps form one group, at the place of the first."""
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


ATTEMPTS = 2
"""How often a change is prepared before it is applied unprepared: other changes may require another step meanwhile."""


@dataclass(frozen=True)
class Prepared:
    """Commands whose assembly is being derived."""

    group: tuple[Command, ...]
    future: "Future[Assembly]"
    attempt: int

    @property
    def is_change(self) -> bool:
        """Whether it changes the run; otherwise it begins another one."""
        return isinstance(self.group[0], ChangeScenario)


class Preparation:
    """One derivation at a time, its commands, and later changes that need another one."""

    def __init__(self, executor: Executor | None = None):
        """`executor` runs the derivations; without one, a thread of its own does."""
        self._executor = executor or ThreadPoolExecutor(1, thread_name_prefix="flexlab-preparation")
        self.current: Prepared | None = None
        """What is being derived, or waits to be applied."""
        self._stopped = False
        self.later: list[ChangeScenario] = []
        """Changes that wait for the present derivation; one derivation for all of them follows."""

    def must_wait(self, command: Command) -> bool:
        """Whether a command must follow the present derivation: any command after a new run, a new run after a change."""
        if self.current is None or isinstance(command, LoadScenario):
            return False
        return begins_run(command) or not self.current.is_change

    def touches(self, changes: Sequence[ChangeScenario]) -> bool:
        """Whether changes set something that a change in preparation, or one that waits for it, sets as well."""
        if self.current is None:
            return False
        before = [old for old in (*self.current.group, *self.later) if isinstance(old, ChangeScenario)]
        paths = [path for old in before for path in old.changes]
        return any(overlap(path, other) for new in changes for path in new.changes for other in paths)

    def start(self, group: tuple[Command, ...], scenario: Scenario, known: Assembly, attempt: int) -> None:
        """Derive the assembly of `scenario` for a group of commands; after `stop`, do nothing."""
        try:
            future = self._executor.submit(build_assembly, scenario, TICK, [known])
        except RuntimeError:
            if self._stopped:  # It may stop at any instant.
                return
            raise
        self.current = Prepared(group, future, attempt)

    def take(self) -> Prepared | None:
        """Take the finished derivation, if there is one."""
        if self.current is None or not self.current.future.done():
            return None
        done, self.current = self.current, None
        return done

    def drop(self) -> None:
        """Drop everything, as another run begins."""
        self.current, self.later = None, []

    def stop(self) -> None:
        """Begin nothing more; a running derivation ends by itself within a second."""
        self._stopped = True
        self._executor.shutdown(wait=False, cancel_futures=True)
