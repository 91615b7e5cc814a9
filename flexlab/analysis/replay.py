"""Simulates a recorded run again from its start and its commands, and looks whether every bit is the same."""

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from flexlab.control.own_law import OwnController
from flexlab.control.own_path import OwnTrajectory
from flexlab.errors import StudyError
from flexlab.recording.documents import package_version
from flexlab.recording.reader import Recording
from flexlab.recording.store.formats import FORMAT
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, Pull, Tap, WorldCommand
from flexlab.sim.samples import MEASURED, Samples
from flexlab.sim.signals import TABLE
from flexlab.sim.world import World
from flexlab.sim.world_state import WorldState

BLOCK_TICKS = 1000
"""Ticks simulated between two comparisons: a difference at the start of an hour is told at once."""


@dataclass(frozen=True)
class Difference:
    """The first place where a replay parts from its recording."""

    time: float
    """Simulation time, s."""
    signal: str
    """Name of the field of `Samples`."""
    recorded: float
    replayed: float


@dataclass(frozen=True)
class Replay:
    """What came of a replay."""

    compared: int
    """Samples that were compared."""
    difference: Difference | None
    """None: all bits are the same."""
    text: str
    """The finding in one sentence."""

    @property
    def identical(self) -> bool:
        """Whether every sample came out bit for bit."""
        return self.difference is None


def replay(recording: Recording, blocks: Iterable[Samples] | None = None) -> Replay:
    """Simulate the run again and compare every signal of every recorded sample bit for bit.

    Of a recording of an older format: the signals that it has and that meant then what they mean today.

    `blocks`: the recorded samples in the order of time, where `recording` was read without them. Raises `StudyError` if the
    recording's commands cannot be carried out again.
    """
    repetition, done = Repetition(recording), 0
    absent: frozenset[str] = frozenset()
    for block in (recording.samples,) if blocks is None else blocks:
        for first in range(0, len(block), BLOCK_TICKS):
            recorded = block.slice(first, first + BLOCK_TICKS)
            again = repetition.samples_until(float(recorded.time[-1]))
            compared, difference = _compare(recorded, again, recording.compared)
            done += compared
            absent |= recorded.absent
            if difference is not None:
                return Replay(done, difference, _difference_text(recording, difference))
            if compared < len(recorded):
                late = float(recorded.time[compared])
                difference = Difference(late, "time", late, np.nan)
                return Replay(done, difference, f"The replay stopped at t = {late:g} s, before the recording's end.")
    return Replay(done, None, f"All {done} samples came out again, bit for bit.{_left_out(recording, absent)}")


def own_law_texts(recording: Recording) -> list[tuple[str, str]]:
    """(kind, text) of the control laws in Python that a recorded run needs, in the order in which they came."""
    law = recording.scenario.controller
    found = [(law.kind, law.source)] if isinstance(law, OwnController) else []
    for event in recording.events:
        if isinstance(event.command, ChangeScenario) and "controller.source" in event.command.changes:
            source = event.command.changes["controller.source"]
            found.append((str(event.command.changes.get("controller.kind", law.kind)), source))
    return list({source: (kind, source) for kind, source in reversed(found)}.values())[::-1]


def own_path_texts(recording: Recording) -> list[str]:
    """The texts of the paths in Python on which a recorded run went, in the order in which they came; no replay needs them."""
    path = recording.scenario.trajectory
    found = [path.source] if isinstance(path, OwnTrajectory) else []
    for event in recording.events:
        if isinstance(event.command, ChangeScenario) and "trajectory.source" in event.command.changes:
            found.append(event.command.changes["trajectory.source"])
    return list(dict.fromkeys(found))


def _left_out(recording: Recording, absent: frozenset[str]) -> str:
    """What an older version recorded otherwise or not at all, as a sentence; empty if there is nothing of the kind."""
    names = sorted(absent | (TABLE.keys() - recording.compared))
    if not names:
        return ""
    version = recording.properties.get("flexlab_version")
    return (
        f" It was recorded by flexlab {version} in format {recording.format}: all that both have was compared, "
        f"without {', '.join(names)}."
    )


class Repetition:
    """A recorded run on its way through a second simulation."""

    def __init__(self, recording: Recording):
        """At the recording's start; nothing is simulated yet."""
        self._world = start_world(recording)
        self._period = recording.sample_period
        self._commands = deque(world_commands(recording))
        self._begun = False

    def samples_until(self, time: float) -> Iterator[Samples]:
        """The samples from where it stands up to `time` s, in blocks; fewer if the run fails. Raises `StudyError`."""
        goal, world = round(time / self._period), self._world
        if not self._begun:
            self._begun = True
            yield world.observe()
        while world.tick < goal and not world.status.failed:
            while self._commands and self._commands[0][0] <= world.tick:
                carry_out(world, self._commands.popleft()[1])
            stop = min(goal, self._commands[0][0] if self._commands else goal)
            yield world.advance(min(stop - world.tick, BLOCK_TICKS))


def _compare(recorded: Samples, repeated: Iterable[Samples], compared: frozenset[str]) -> tuple[int, Difference | None]:
    """(how many samples were compared, the first difference); of what is repeated, what was not recorded is left out.

    `compared`: the table's signals to look at; a law's own are all looked at.
    """
    done = 0
    for again in repeated:
        # A gap: samples dropped, a disk that was full.
        rows = np.searchsorted(recorded.time, again.time)
        there = (rows < len(recorded)) & (recorded.time[np.minimum(rows, len(recorded) - 1)] == again.time)
        difference = _first_difference(recorded.take(rows[there]), again.take(there), compared)
        done += int(np.count_nonzero(there))
        if difference is not None:
            return done, difference
    return done, None


def recording_span(recording: Recording) -> tuple[float, float]:
    """First and last instant of a recording, s. Raises `StudyError` if it has no samples."""
    if len(recording.samples) == 0:
        raise StudyError(f"{recording.path.name} has no samples: there is nothing to go on from.")
    return float(recording.samples.time[0]), float(recording.samples.time[-1])


def state_at(recording: Recording, time: float, span: tuple[float, float] | None = None) -> tuple[Scenario, WorldState]:
    """Scenario and state of the run at simulation time `time` s (to the nearest sample), to go on from there.

    Commands given at that very instant have taken effect. `span`: first and last recorded instant, s, for a recording that
    was read without its samples. Raises `StudyError` for a time that was not recorded.
    """
    first, last = span or recording_span(recording)
    # Half a sample's grace: a time that was typed is not the last bit of a time that was computed.
    if not first - recording.sample_period / 2 <= time <= last + recording.sample_period / 2:
        raise StudyError(f"t = {time:g} s was not recorded: choose {first:.10g} to {last:.10g} s.")
    world = start_world(recording)
    goal = round(time / recording.sample_period)
    for tick, command in world_commands(recording):
        if tick > goal:
            break
        _advance_to(world, tick)
        carry_out(world, command)
    _advance_to(world, goal)
    if world.status.failed:
        raise StudyError(f"The run cannot go on from t = {time:g} s: {world.status.text}")
    return world.scenario, world.state()


def _advance_to(world: World, tick: int) -> None:
    """In blocks, so that hours need no more memory than seconds."""
    while world.tick < tick and not world.status.failed:
        world.advance(min(tick - world.tick, BLOCK_TICKS))


def start_world(recording: Recording) -> World:
    """The world as it stood at the recording's first sample of part 1. Raises `StudyError` for what was not simulated."""
    if recording.status == MEASURED:
        raise StudyError(f"{recording.path.stem} was measured, not simulated: it can be looked at and compared.")
    world = World(recording.scenario, recording.sample_period)
    if recording.start is not None:
        world.restore(recording.start)
    return world


def world_commands(recording: Recording) -> tuple[tuple[int, WorldCommand], ...]:
    """(tick, command) of every command that changed the simulation, in order."""
    return tuple(
        (round(event.time / recording.sample_period), event.command)
        for event in recording.events
        if isinstance(event.command, (ChangeScenario, Pull, Tap)) and event.level != "error"
    )


def carry_out(world: World, command: WorldCommand) -> None:
    """Apply a recorded command. Raises `StudyError` if the world does not take it as the recorded one did."""
    width = world.row_length
    if world.apply(command) or world.row_length != width:
        raise StudyError("The recording goes on after a change of structure, which begins a new run: it is not whole.")


def _first_difference(recorded: Samples, again: Samples, compared: frozenset[str]) -> Difference | None:
    """The earliest row that differs in any bit, and the first signal in it that does."""
    found: tuple[int, str] | None = None
    present = again.signals()
    for name, one in recorded.signals().items():
        if name not in present or (name in TABLE and name not in compared):
            continue
        other = present[name]
        if one.shape != other.shape:
            return Difference(float(recorded.time[0]), name, np.nan, np.nan)
        unlike = _bits(one) != _bits(other)
        rows = np.flatnonzero(unlike.any(axis=1))
        if len(rows) and (found is None or rows[0] < found[0]):
            found = (int(rows[0]), name)
    if found is None:
        return None
    row, name = found
    one, other = getattr(recorded, name)[row].ravel(), getattr(again, name)[row].ravel()
    column = int(np.flatnonzero(_bits(one[None])[0] != _bits(other[None])[0])[0])
    return Difference(float(recorded.time[row]), name, float(one[column]), float(other[column]))


def _bits(signal: np.ndarray) -> np.ndarray:
    flat = signal.reshape(len(signal), math.prod(signal.shape[1:]))
    return np.ascontiguousarray(flat).view(np.int64)


def _difference_text(recording: Recording, difference: Difference) -> str:
    made = recording.properties
    return (
        f"The replay differs first at t = {difference.time:g} s in {difference.signal}: recorded {difference.recorded!r}, "
        f"now {difference.replayed!r}. It was recorded by flexlab {made.get('flexlab_version')} (format {recording.format}) "
        f"with numpy {made.get('numpy_version')} on {made.get('machine')}; this is flexlab {package_version()} "
        f"(format {FORMAT}) with numpy {np.__version__}."
    )
