"""What is needed besides the samples and the scenario of a run to record it and to simulate it again.

From it follows, too, whether samples are close enough for metrics of the vibration.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from types import SimpleNamespace

from flexlab.physics.mass_change import FACTOR, find_mass
from flexlab.scenario import Payload, Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.commands import ChangeScenario, Pull, WorldCommand, command_text
from flexlab.sim.samples import Run, WorldState
from flexlab.sim.simulate import tick_at
from flexlab.sim.snapshot import SHORTEST_PERIOD, Event
from flexlab.text import number_text

FEWEST = 8
"""Fewest samples per period of the beam's first mode: with fewer, a peak may be 8 % higher than the highest sample."""


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


def first_frequency(payload: Payload) -> float:
    """f1 of the payload with its grips held, Hz."""
    return float(min(build_beam(payload).modes.omega)) / math.tau


def _lightest(payload: Payload, until: float) -> float:
    """Least mass of a payload up to an instant, s, over its mass at the start."""
    now = SimpleNamespace(mass_factor=[1.0, 0.0])
    find_mass(payload.mass_change, until, now)
    return min(1.0, now.mass_factor[FACTOR])


def coarse_note(scenario: Scenario, period: float, until: float, events: Sequence[Event] = ()) -> str:
    """A sentence if samples `period` s apart are too few for metrics of a vibration in the beam's first mode, grips held.

    Otherwise "". Metrics of too few samples may differ much from those of the motion. `scenario`: at the run's start; `until`:
    its last instant, s, up to which `events` may have made the beam stiffer or the payload may have been emptied.
    """
    payloads = [each.payload for each in scenarios(scenario, events, until)]
    # f1 is proportional to the root of this: a change of length, boundary or mesh begins a new run.
    payload = max(payloads, key=lambda one: one.bending_stiffness / (one.linear_density * _lightest(one, until)))
    frequency = first_frequency(payload) / math.sqrt(_lightest(payload, until))
    if not period * frequency * FEWEST > 1:
        return ""
    digits = 10.0 ** math.floor(math.log10(1 / (FEWEST * frequency)))
    enough = digits * math.floor(1 / (FEWEST * frequency) / digits)
    advice = f"Take samples every {number_text(1e3 * enough)} ms or more often."
    if enough < SHORTEST_PERIOD:
        advice = f"Even the shortest sample period, {number_text(1e3 * SHORTEST_PERIOD)} ms, is too long for that."
    return (
        f"Samples are {number_text(1e3 * period)} ms apart, and the beam's first mode has a period of "
        f"{number_text(1e3 / frequency, 3)} ms: peaks, settling time and RMS of the vibration may be far off. {advice}"
    )
