"""Formats of recordings, and the steps that give samples of an older format today's meaning.

The format's number goes up when something that is recorded changes its meaning; that needs a step in `STEPS`, a golden
recording in the tests, and `since` in the table of signals. A further signal needs none of this: a recording names its
signals, and those that it lacks are absent. A newer recording is read too, unless it says that this reader is too old.
"""

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any

import numpy as np

from flexlab.errors import ScenarioError
from flexlab.physics.beam import quasi_static_deflection
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam, build_plant
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Samples
from flexlab.sim.signals import TABLE
from flexlab.sim.snapshot import Event
from flexlab.sim.target import build_trajectory, change_path, desired_at

FORMAT = 4
"""Format of recordings that are written now."""
OLDEST_READER = 3
"""Oldest format whose reader understands recordings that are written now: see `readable`."""
ARITHMETIC = "1"
"""Name of the arithmetic by which samples are computed now. A recording that names the same one is reproduced bit for bit on any
machine; a recording that names another, or none, was computed with other rounding errors."""
OLD_QUASI_STATIC = "quasi_static_deflection_of_format_1"
"""The quasi-static deflection of format 1: that of the actual acceleration, which jumps."""


# No replay would compare a signal of a format that is not written yet.
if _late := [name for name, signal in TABLE.items() if max(signal.since, signal.computed_since) > FORMAT]:
    raise ValueError(f"{', '.join(_late)}: since is above format {FORMAT}, which is written now: leave it out.")


def readable(properties: dict) -> bool:
    """Whether this version understands a recording with these properties."""
    return properties["format"] <= FORMAT or properties.get("oldest_reader", properties["format"]) <= FORMAT


def checked_format(number: Any, newest: int = FORMAT) -> int:
    """The number of a format, 1 to `newest`. Raises ValueError for anything else."""
    if type(number) is not int or not 1 <= number <= newest:
        raise ValueError(f"its samples were computed in format {number!r:.40}, and there are 1 to {newest}")
    return number


def same_numbers(recorded_format: int) -> frozenset[str]:
    """The table's signals with the same meaning in that format as today, computed the same way to the last bit."""
    return frozenset(n for n, signal in TABLE.items() if max(signal.since, signal.computed_since) <= recorded_format)


class Changes:
    """The scenarios of a recorded run over time, as its changes made them."""

    def __init__(self, scenario: Scenario, events: Iterable[Event]):
        self._times = [-np.inf]
        self.scenarios = [scenario]
        """In the order of time, from that at the run's start."""
        for event in events:
            if isinstance(event.command, ChangeScenario) and event.level != "error":
                try:
                    scenario = change_path(scenario, event.command.changes, event.time)
                except ScenarioError:
                    continue  # A setting of another version: the scenario stays as it was.
                self._times.append(event.time)
                self.scenarios.append(scenario)

    def pieces(self, time: np.ndarray) -> Iterable[tuple[slice, Scenario]]:
        """(rows, scenario) for instants (N,), s, in order. A sample is taken before the commands of its instant."""
        ends = [*np.searchsorted(time, self._times[1:], "right"), len(time)]
        first = 0
        for end, scenario in zip(ends, self.scenarios, strict=True):
            if end > first:
                yield slice(first, int(end)), scenario
                first = int(end)


def migrate(samples: Samples, recorded_format: int, changes: Callable[[], Changes]) -> Samples:
    """Samples of an older format as they would be recorded now. `changes` is asked for only where a step needs it."""
    for number in range(recorded_format, FORMAT):
        samples = STEPS[number](samples, changes)
    return samples


def _from_1(samples: Samples, changes: Callable[[], Changes]) -> Samples:
    """Compute the quasi-static deflection anew, as that of the desired motion, which follows from the scenario."""
    found = np.empty(len(samples))
    for rows, scenario in changes().pieces(samples.time):
        trajectory = build_trajectory(scenario)
        known = _compliance(scenario), scenario.gravity
        found[rows] = [quasi_static_deflection(*known, desired_at(trajectory, t)) for t in samples.time[rows]]
    found.flags.writeable = False
    old = samples.signals().get("quasi_static_deflection")
    kept = {} if old is None else {OLD_QUASI_STATIC: old}
    return samples.having(quasi_static_deflection=found, **kept)


@lru_cache(maxsize=64)
def _compliance(scenario: Scenario) -> np.ndarray:
    return build_plant(scenario, build_beam(scenario.payload)).compliance


STEPS: dict[int, Callable[[Samples, Callable[[], Changes]], Samples]] = {
    1: _from_1,
    2: lambda samples, _: samples,
    3: lambda samples, _: samples,
}
"""From each older format to the next. Format 3 packs the samples otherwise (`codec`); 4 computes the loss more exactly."""
