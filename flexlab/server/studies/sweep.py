"""The sweep of the page *Studies*: a map of each metric that fills as cells are computed; each cell opens in the lab."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from flexlab.analysis.metrics.metric import numbers
from flexlab.analysis.metrics.run_metrics import DURATION
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.plan import Plan, make_plan
from flexlab.analysis.sweep.result import TABLE, read_part, run_sweep
from flexlab.errors import StudyError
from flexlab.quantities import Quantity
from flexlab.scenario import Scenario
from flexlab.scenario.field_text import TITLES
from flexlab.scenario.settings import change_settings
from flexlab.server.studies import ELSEWHERE, LONGEST_RUN, MOST_VALUES, Form, Found, Study, axes_of, check_work, workers
from flexlab.server.task_book import Outcome, Task

SAMPLE_PERIOD = 1e-3
"""Time between two samples of a cell, s."""
Columns = Mapping[str, Sequence[Any]]


@dataclass
class SweepStudy(Study):
    """A sweep over one or two fields."""

    kind, place, title, run_words, is_map = "sweep", 10, "Sweep", "cell", True
    what = (
        "Simulates the scenario for every pair of values and draws each metric as a map: where it rings, where it fails. "
        f"At most {MOST_VALUES} cells of {LONGEST_RUN:g} s."
    )

    scenario: Scenario
    """The scenario that is varied, with the accuracy of a lab's run, finer than a cell's."""
    axes: tuple[Axis, ...]
    plan: Plan
    _parts: dict[range, Columns] = field(default_factory=dict[range, Columns], init=False)
    """The parts that were read while it is computed; their files are removed at its end."""

    @classmethod
    def read(cls, form: Form, scenario: Scenario, duration: float) -> "SweepStudy":
        """The sweep that a form asks for. Raises `StudyError` or `ScenarioError`."""
        plan = make_plan(scenario, axes_of(form, scenario, counted=True), duration, SAMPLE_PERIOD)
        if plan.cell_count > MOST_VALUES:
            raise StudyError(
                f"{plan.cell_count} cells are too many for this page: choose fewer values, {MOST_VALUES} cells at most, "
                f"{ELSEWHERE}: flexlab sweep."
            )
        check_work(plan.cell_count, duration, "cells", "sweep")
        return cls(scenario, plan.axes, plan)

    def job(self) -> Callable[..., Outcome]:
        """The function that computes the plan's cells."""
        return partial(sweep_study, self.plan)

    def drawing(self, task: Task) -> dict[str, Any] | None:
        """`page_data` of the cells that are done."""
        if not task.working:
            return task.result
        for cells in self.plan.parts():
            if cells not in self._parts and (part := read_part(task.folder, self.plan, cells)) is not None:
                self._parts[cells] = part
        return page_data(self.plan, list(self._parts.values()))

    def found(self, task: Task) -> Found:
        """The table of all cells."""
        return Found(table=task.folder / TABLE)

    def cell_scenario(self, cell: int) -> Scenario:
        """A cell's scenario for the lab. Raises `StudyError` if there is no such cell, `ScenarioError` if it is invalid."""
        if not 0 <= cell < self.plan.cell_count:
            raise StudyError(f"This sweep has the cells 0 to {self.plan.cell_count - 1}.")
        return change_settings(self.scenario, self.plan.changes(cell))


STUDY = SweepStudy


def sweep_study(plan: Plan, folder: Path, report: Callable[[float], None]) -> Outcome:
    """Compute a sweep in `folder`; the result is its `page_data`."""
    sweep = run_sweep(plan, folder, workers(), lambda done, total: report(done / total))
    return Outcome(page_data(plan, [sweep.columns()]))


def page_data(plan: Plan, tables: Iterable[Columns]) -> dict[str, Any]:
    """The data that the page's script draws: axes, metrics, and each cell's status, sentence and numbers.

    `tables`: columns by name, of some or all cells; the status of a missing cell is None.
    """

    def by_cell(name: str) -> list[Any]:
        found: list[Any] = [None] * plan.cell_count
        for table in tables:
            for cell, value in zip(table["cell"], table[name], strict=True):
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
    about = scenario.about(axis.path) if scenario.has(axis.path) else Quantity(axis.path)
    return {
        "path": axis.path,
        "title": TITLES.get(axis.path, about.title),
        "symbol": about.symbol,
        "unit": about.unit_text().strip(),
        "values": list(axis.values),
        "numeric": axis.numeric,
        "logarithmic": axis.logarithmic,
    }
