"""A run that was kept to compare others with: its samples, and what sets it apart from the present run."""

from dataclasses import dataclass

import numpy as np

from flexlab.analysis.metrics import MetricRow, run_metrics
from flexlab.errors import LabError
from flexlab.scenario import Scenario
from flexlab.scenario.differences import differences as differences
from flexlab.sim.runner import Runner
from flexlab.sim.samples import Samples
from flexlab.sim.snapshot import TICK

LONGEST = 30.0
"""How much of a run is kept, s: what the engine remembers."""


@dataclass(frozen=True)
class ReferenceRun:
    """The newest `LONGEST` seconds of a run, exactly as they were computed, with the scenario it ended in."""

    name: str
    scenario: Scenario
    samples: Samples

    @property
    def span(self) -> tuple[float, float]:
        """First and last kept instant, s."""
        return float(self.samples.time[0]), float(self.samples.time[-1])

    def at(self, time: float) -> Samples | None:
        """The sample (N = 1) nearest to a simulation time, s, or None outside `span`."""
        row = round((time - self.span[0]) / TICK)
        return self.samples.slice(row, row + 1) if 0 <= row < len(self.samples) else None


def keep_run(runner: Runner) -> ReferenceRun:
    """Keep the present run; raises `LabError` while there is nothing to keep."""
    samples, snapshot = runner.recent(LONGEST), runner.snapshot
    if len(samples) < 2:
        raise LabError("There is nothing to keep yet: press play and let the run go on for a moment.")
    return ReferenceRun(snapshot.name, snapshot.scenario, samples)


def common_metrics(
    kept: ReferenceRun, samples: Samples
) -> tuple[list[tuple[MetricRow, MetricRow]], tuple[float, float]]:
    """Metric rows of the kept run and of `samples` over the simulation times that both have, and these times, s.

    Empty if they have none in common.
    """
    first = max(kept.span[0], float(samples.time[0])) if len(samples) else np.inf
    last = min(kept.span[1], float(samples.time[-1])) if len(samples) else -np.inf
    if last - first < TICK:
        return [], (0.0, 0.0)
    ours, theirs = (run_metrics(run, (first, last)).rows for run in (kept.samples, samples))
    return list(zip(ours, theirs, strict=True)), (first, last)
