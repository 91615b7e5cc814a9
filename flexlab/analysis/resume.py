"""Repeated simulation of a recorded run, to continue it in a lab from any instant with its exact state, or to compare."""

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

from flexlab.errors import StudyError
from flexlab.recording.reader import Recording
from flexlab.scenario import Scenario
from flexlab.sim.bumpless_transfer import same_motion
from flexlab.sim.commands import WorldCommand
from flexlab.sim.samples import MEASURED, Origin, Samples, WorldState
from flexlab.sim.snapshot import TICK
from flexlab.sim.world import World
from flexlab.text import number_text

MILLI = 1e3
BLOCK_TICKS = 1000
"""Ticks per block: long runs need no more memory than short ones, and an early difference is found early."""


def resume(recording: Recording, time: float | None = None) -> tuple[Scenario, Origin]:
    """Scenario and origin with which a lab continues a run at simulation time `time`, s; None: at its end.

    Raises `StudyError` for a time that was not recorded, or that is not a sample instant of a lab.
    """
    scenario, state = state_at(recording, recording.span[1] if time is None else time)
    # The sample period of a headless run may differ from a lab's.
    exact = state.tick * recording.sample_period
    tick = round(exact / TICK)
    if abs(tick * TICK - exact) > 1e-9 * max(exact, 1.0):
        raise StudyError(
            f"t = {exact:.10g} s is not an instant of a lab, which takes a sample every {MILLI * TICK:g} ms: choose a multiple."
        )
    return scenario, Origin(recording.path.stem, tick * TICK, replace(state, tick=tick))


def state_at(recording: Recording, time: float) -> tuple[Scenario, WorldState]:
    """Scenario and state of the run at the sample nearest to simulation time `time`, s, after the commands of that instant.

    Raises `StudyError` for a time that was not recorded.
    """
    first, last = recording.span
    # Half a sample of tolerance, as a typed time has fewer digits than a computed one.
    if not first - recording.sample_period / 2 <= time <= last + recording.sample_period / 2:
        asked, low, high = (number_text(value, 10) for value in (time, first, last))
        raise StudyError(f"t = {asked} s was not recorded: choose {low if first == last else f'{low} to {high}'} s.")
    again = Repetition(recording)
    for _ in again.samples_until(time):
        pass
    again.carry_out_due()
    if again.world.status.failed:
        raise StudyError(f"The run cannot go on from t = {time:g} s: {again.world.status.text}")
    return again.world.scenario, again.world.state()


class Repetition:
    """The second simulation of a recorded run."""

    def __init__(self, recording: Recording):
        """Start at the recording's first sample. Raises `StudyError` for a measurement, which cannot be simulated."""
        if recording.status == MEASURED:
            raise StudyError(f"{recording.path.stem} was measured, not simulated: it can be looked at and compared.")
        self._period = recording.sample_period
        self.world = World(recording.scenario, self._period)
        if recording.start is not None:
            self.world.restore(recording.start)
        self._commands = deque(
            (round(event.time / self._period), event.command)
            for event in recording.events
            if isinstance(event.command, WorldCommand) and event.level != "error"
        )
        self._begun = False

    def samples_until(self, time: float) -> Iterator[Samples]:
        """The next samples up to `time`, s, in blocks; fewer if the run fails. Raises `StudyError`."""
        goal, world = round(time / self._period), self.world
        if not self._begun:
            self._begun = True
            yield world.observe()
        while world.tick < goal and not world.status.failed:
            self.carry_out_due()
            stop = min(goal, self._commands[0][0] if self._commands else goal)
            yield world.advance(min(stop - world.tick, BLOCK_TICKS))

    def carry_out_due(self) -> None:
        """Apply the commands of the present instant. Raises `StudyError` for a change of the structure."""
        world = self.world
        while self._commands and self._commands[0][0] <= world.tick and not world.status.failed:
            before = world.scenario
            if world.apply(self._commands.popleft()[1]) and not same_motion(before, world.scenario):
                raise StudyError(
                    "The recording goes on after a change of structure, where a new run begins: it is not complete."
                )
