"""A sweep as its page draws it, while it is computed and when it is done."""

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flexlab.analysis.metrics import METRICS
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.plan import Plan
from flexlab.analysis.sweep.table import read_part
from flexlab.errors import FlexlabError
from flexlab.scenario import Scenario
from flexlab.scenario.choices import TITLES

Columns = Mapping[str, Sequence[Any]]


def page_data(plan: Plan, table: Columns) -> dict[str, Any]:
    """What the page's script takes: axes, metrics, and per cell its status, sentence and numbers.

    `table`: columns by name, of some cells or all. Of a cell that is not there the status is None.
    """
    columns = [column for metric in METRICS.values() for column in metric.columns if column.field != "window"]
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
                "field": column.field,
                "title": column.title,
                "unit": column.unit,
                "missing": column.missing,
                "values": by_cell(column.key),
            }
            for column in columns
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
