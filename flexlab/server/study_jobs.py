"""What the page of studies has computed in a process of its own: each function is one job."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.execution import on_threads, run_sweep
from flexlab.analysis.sweep.plan import Plan
from flexlab.analysis.sweep.result import Sweep
from flexlab.analysis.tuning.cost import Cost, numbers_of
from flexlab.analysis.tuning.search import Candidate, tune
from flexlab.scenario import Scenario
from flexlab.server.growing_sweep import page_data

Report = Callable[[float], None]


@dataclass(frozen=True)
class Tuned:
    """What a search found."""

    changes: dict[str, float]
    """Field → value, of the best candidate."""
    before: dict[str, float] | None
    """Metric → number of the scenario as it was; None: it fails."""
    after: dict[str, float] | None
    cost: tuple[float, float]
    """Before and after."""
    holds: bool
    """Whether the best candidate keeps within the limits."""
    tried: int
    scenario: Scenario
    points: tuple[tuple[float, float], ...]
    """Of every candidate that ran: the metric that was made small, and RMS internal force."""


def threads() -> int:
    """How many a study takes: one core stays for the labs."""
    return max((os.cpu_count() or 1) - 1, 1)


def sweep_study(plan: Plan, folder: Path, report: Report) -> dict[str, Any]:
    """Compute a sweep in `folder`; what the page draws, as plain data."""
    run_sweep(plan, folder, on_threads(threads()), lambda done, total: report(done / total))
    return page_data(plan, Sweep(plan, folder).columns())


def tuning_study(
    scenario: Scenario, axes: tuple[Axis, ...], cost: Cost, duration: float, candidates: int, report: Report
) -> Tuned:
    """Search the ranges for what costs least."""
    found = tune(
        scenario, axes, cost, (), duration, candidates, told=lambda done, total: report(min(done / total, 1.0))
    )
    best, first = found.best, cost.names[0]
    ran = [numbers_of(candidate.metrics) for candidate in found.candidates if candidate.metrics is not None]
    return Tuned(
        {path: float(value) for path, value in best.changes.items()},
        _numbers(found.before),
        _numbers(best),
        (found.before.cost, best.cost),
        best.metrics is not None and cost.holds(best.metrics),
        len(found.candidates),
        found.tuned,
        tuple((numbers[first], numbers["force"]) for numbers in ran),
    )


def _numbers(candidate: Candidate) -> dict[str, float] | None:
    return None if candidate.metrics is None else numbers_of(candidate.metrics)
