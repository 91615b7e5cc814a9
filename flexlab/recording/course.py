"""What is needed besides the samples and the scenario of a run to record it and to simulate it again."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf

from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, Pull, WorldCommand, command_text
from flexlab.sim.samples import Run, WorldState
from flexlab.sim.simulate import tick_at
from flexlab.sim.snapshot import Event


@dataclass(frozen=True)
class Course:
    """The course of a run: its sample period, its events, the state at its start, and what computed it."""

    sample_period: float
    """s."""
    events: tuple[Event, ...] = ()
    """In the order in which they took effect."""
    start: WorldState | None = None
    """The world's state at the first sample; None: the scenario's own start."""
    recorded_by: Mapping[str, str | int] | None = None
    """As in `RunInfo`."""

    @property
    def is_changed(self) -> bool:
        """Whether the scenario was changed, or something was pulled, during the run."""
        return any(isinstance(event.command, (ChangeScenario, Pull)) for event in self.events)


def is_pulled(events: Sequence[Event], since: float = inf) -> bool:
    """Whether beam or arm is still held after these events of a run, or was let go later than `since`, s."""
    last = next((event for event in reversed(events) if isinstance(event.command, Pull)), None)
    return last is not None and (last.time > since or getattr(last.command, "stiffness", 0.0) > 0)


def scenarios(scenario: Scenario, events: Sequence[Event], before: float = inf) -> Iterator[Scenario]:
    """`scenario`, with which a run began, and the one after each of its changes before an instant, s. Raises `ScenarioError`."""
    yield scenario
    for event in events:
        if isinstance(event.command, ChangeScenario) and event.level != "error" and event.time < before:
            scenario = scenario.replace(event.command.changes)
            yield scenario


def changed_scenario(scenario: Scenario, events: Sequence[Event], before: float = inf) -> Scenario:
    """The last of the `scenarios` of a run. Raises `ScenarioError`."""
    *_, last = scenarios(scenario, events, before)
    return last


def course_of_commands(run: Run, commands: Sequence[tuple[float, WorldCommand]], sample_period: float) -> Course:
    """The course of a run that was simulated with commands; those after its end had no effect."""
    ticks = len(run) - (0 if run.status.failed else 1)
    due = [(tick_at(time, sample_period), command) for time, command in sorted(commands, key=lambda item: item[0])]
    events = [Event(float(run.time[tick]), command_text(command), command) for tick, command in due if tick < ticks]
    return Course(float(sample_period), tuple(events))
