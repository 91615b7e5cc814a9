"""Slow derivations beside the running world: modes and matrix functions of fine meshes, on a thread of their own."""

from collections.abc import Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass

from flexlab.scenario import Scenario
from flexlab.sim.assembly import Assembly, build_assembly
from flexlab.sim.command_queue import begins_run, overlap
from flexlab.sim.commands import ChangeScenario, Command, LoadScenario
from flexlab.sim.snapshot import TICK

ATTEMPTS = 2
"""Times that a change is prepared before the world takes it on unprepared: gains may move the step meanwhile, but not for
ever."""


@dataclass(frozen=True)
class Prepared:
    """Commands whose assembly is being derived."""

    group: tuple[Command, ...]
    future: "Future[Assembly]"
    attempt: int

    @property
    def is_change(self) -> bool:
        """Whether the run goes on with it; otherwise another one begins."""
        return isinstance(self.group[0], ChangeScenario)


class Preparation:
    """One derivation at a time, what it is for, and the changes that came after it and want another one."""

    def __init__(self, executor: Executor | None = None):
        """With an `executor` the derivations run there."""
        self._executor = executor or ThreadPoolExecutor(1, thread_name_prefix="flexlab-preparation")
        self._current: Prepared | None = None
        self._stopped = False
        self.later: list[ChangeScenario] = []
        """Changes that wait for the present derivation, to be derived together after it."""

    @property
    def current(self) -> Prepared | None:
        """What is being derived, or waits to be taken on."""
        return self._current

    def must_wait(self, command: Command) -> bool:
        """Whether a command is meant for what is being prepared: all that follows a new run, a new run after a change."""
        if self._current is None or isinstance(command, LoadScenario):
            return False
        return begins_run(command) or not self._current.is_change

    def touches(self, changes: Sequence[ChangeScenario]) -> bool:
        """Whether changes set something that a change which is being prepared, or waits to be, sets as well."""
        if self._current is None:
            return False
        before = [old for old in (*self._current.group, *self.later) if isinstance(old, ChangeScenario)]
        paths = [path for old in before for path in old.changes]
        return any(overlap(path, other) for new in changes for path in new.changes for other in paths)

    def start(self, group: tuple[Command, ...], scenario: Scenario, known: Assembly, attempt: int) -> None:
        """Derive the assembly of `scenario` for a group of commands; nothing once this is stopped."""
        try:
            future = self._executor.submit(build_assembly, scenario, TICK, [known])
        except RuntimeError:
            if self._stopped:  # At whatever instant: nobody waits for it any more.
                return
            raise
        self._current = Prepared(group, future, attempt)

    def take(self) -> Prepared | None:
        """The finished derivation, if there is one: it is then the caller's."""
        if self._current is None or not self._current.future.done():
            return None
        done, self._current = self._current, None
        return done

    def drop(self) -> None:
        """Forget all of it: another run begins."""
        self._current, self.later = None, []

    def stop(self) -> None:
        """Begin nothing more; what runs ends by itself, within a second."""
        self._stopped = True
        self._executor.shutdown(wait=False, cancel_futures=True)
