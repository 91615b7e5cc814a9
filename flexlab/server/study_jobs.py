"""What the page of studies has computed in a process of its own, and a sweep as its page draws it while it grows."""

import os
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexlab.analysis.metrics.names import numbers
from flexlab.analysis.metrics.run_metrics import DURATION
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.plan import Plan
from flexlab.analysis.sweep.result import Sweep, read_part, run_sweep
from flexlab.analysis.tuning import Candidate, Cost, numbers_of, tune
from flexlab.analysis.workers import chosen_workers
from flexlab.errors import FlexlabError
from flexlab.scenario import Scenario
from flexlab.scenario.choices import TITLES

Columns = Mapping[str, Sequence[Any]]


def page_data(plan: Plan, table: Columns) -> dict[str, Any]:
    """What the page's script takes: axes, metrics, and per cell its status, sentence and numbers.

    `table`: columns by name, of some cells or all. Of a cell that is not there the status is None.
    """
    cells, count = table.get("cell", ()), plan.cell_count

    def by_cell(name: str) -> list[Any]:
        found: list[Any] = [None] * count
        for cell, value in zip(cells, table.get(name, ()), strict=True):
            found[cell] = value
        return found

    return {
        "axes": [_axis_data(plan.scenario, axis) for axis in plan.axes],
        "metrics": [
            {
                "field": number.column.field,
                "title": number.column.title,
                "unit": number.column.unit,
                "missing": number.column.missing,
                "values": [None if value is None else number.column.scale * value for value in by_cell(number.name)],
            }
            for number in numbers()
            if number.metric != DURATION
        ],
        "status": by_cell("status"),
        "sentence": by_cell("sentence"),
    }


def _axis_data(scenario: Scenario, axis: Axis) -> dict[str, Any]:
    symbol = unit = ""
    try:
        about = scenario.about(axis.path)
        title, symbol, unit = TITLES.get(axis.path, about.title), about.symbol, about.unit
    except FlexlabError:
        title = TITLES.get(axis.path, axis.path)
    return {
        "path": axis.path,
        "title": title,
        "symbol": symbol,
        "unit": "" if unit == "1" else unit,
        "values": list(axis.values),
        "numeric": axis.numeric,
        "logarithmic": axis.logarithmic,
    }


class GrowingSweep:
    """A sweep that is being computed in a folder: what is new is read once. For any thread."""

    def __init__(self, plan: Plan, folder: Path):
        self._plan, self._folder = plan, folder
        self._missing = list(plan.parts())
        self._table: dict[str, list[Any]] = {}
        self._lock = threading.Lock()

    def data(self) -> dict[str, Any]:
        """As `page_data`, of the cells that are done."""
        with self._lock:
            parts = {cells: read_part(self._folder, self._plan, cells) for cells in self._missing}
            for cells, part in parts.items():
                if part is not None:
                    self._missing.remove(cells)
                    for name, values in part.items():
                        self._table.setdefault(name, []).extend(values)
            return page_data(self._plan, self._table)


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
    run_sweep(plan, folder, chosen_workers(threads()), lambda done, total: report(done / total))
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
