"""A run kept for comparison: its samples, and its metrics beside those of the present run."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from flexlab.analysis.metrics import MetricRow, run_metrics
from flexlab.errors import LabError
from flexlab.scenario import Scenario
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples, join_blocks
from flexlab.sim.snapshot import TICK

LONGEST = 30.0
"""Longest part of a run that is compared, s; the engine keeps twice as much."""
MOST_KEPT = 300.0
"""Longest part of a run that is kept, s, counted from its start: 180 MB."""

Recorded = Callable[[float], Samples]
"""Reads the recorded part of the present run from its start to an instant, s. Raises `FlexlabError` if it was not recorded."""


@dataclass(frozen=True)
class ReferenceRun:
    """A run, or a part of it, exactly as it was computed, with its scenario at the end."""

    name: str
    scenario: Scenario
    samples: Samples

    @property
    def span(self) -> tuple[float, float]:
        """First and last kept instant, s."""
        return float(self.samples.time[0]), float(self.samples.time[-1])

    def at(self, time: float) -> Samples | None:
        """The sample (N = 1) nearest to a simulation time, s, or None outside `span` and where samples were not recorded."""
        row = int(np.searchsorted(self.samples.time, time - TICK / 2))
        found = self.samples.slice(row, row + 1)
        return found if len(found) and found.time[0] <= time + TICK / 2 else None


def keep_run(runner: Runner) -> ReferenceRun:
    """Keep the part of the present run that the engine still has; raises `LabError` while there is none."""
    samples, snapshot = runner.recent(LONGEST), runner.snapshot
    if len(samples) < 2:
        raise LabError("There is nothing to keep yet: press play and let the run go on for a moment.")
    return ReferenceRun(snapshot.name, snapshot.scenario, samples)


def whole_run(newest: ReferenceRun, start: float, recorded: Recorded) -> ReferenceRun:
    """The whole run whose `newest` part was kept, from its `start`, s; only its first `MOST_KEPT` seconds if it is longer.

    The recorded part ends a moment before now; the rest is in `newest`. Takes a second or two for a minute. Raises
    `FlexlabError` if the run was not recorded, or if a part between the two is missing.
    """
    first = newest.span[0]
    if first - start < TICK / 2:
        return newest
    earlier = recorded(min(first - TICK / 2, start + MOST_KEPT))
    if abs(float(earlier.time[0]) - start) > TICK / 2:
        raise LabError("The beginning of this run was not recorded.")
    if first > start + MOST_KEPT:
        return replace(newest, samples=earlier)
    if abs(float(earlier.time[-1]) + TICK - first) > TICK / 2:
        raise LabError("A part of this run was not recorded.")
    return replace(newest, samples=join_blocks([earlier, newest.samples]))


def common_metrics(
    kept: ReferenceRun, samples: Samples
) -> tuple[list[tuple[MetricRow, MetricRow]], tuple[float, float]]:
    """Metric rows of the kept run and of `samples` over the span of simulation time that both have, and that span, s.

    Empty if they share none.
    """
    first = max(kept.span[0], float(samples.time[0])) if len(samples) else np.inf
    last = min(kept.span[1], float(samples.time[-1])) if len(samples) else -np.inf
    if last - first < TICK:
        return [], (0.0, 0.0)
    ours, theirs = (run_metrics(run, (first, last)).rows for run in (kept.samples, samples))
    return list(zip(ours, theirs, strict=True)), (first, last)
