"""A finished sweep, as Python users get it: its table, its cells, and what it looks like."""

from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.plan import Plan
from flexlab.analysis.sweep.table import TABLE
from flexlab.errors import StudyError
from flexlab.html_table import html_table
from flexlab.scenario import Scenario

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

HTML_ROWS = 10
"""Rows of the table in a notebook."""


class Sweep:
    """A scenario with some fields varied: `table` has a row per cell, with its values, its status and its metrics."""

    def __init__(self, plan: Plan, folder: Path):
        """The finished sweep of a plan in its folder."""
        self.plan, self.folder = plan, folder

    @cached_property
    def table(self) -> pa.Table:
        """All cells: number, varied fields by path, status, sentence, metrics by title and unit."""
        return parquet.read_table(self.folder / TABLE)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """What was varied."""
        return self.plan.axes

    @property
    def is_grid(self) -> bool:
        """Whether the cells are all combinations of values."""
        return self.plan.samples is None

    def __len__(self) -> int:
        return self.plan.cell_count

    def column(self, name: str) -> np.ndarray:
        """A column of numbers, (cells,); NaN where a cell has none. Raises `StudyError`."""
        if name not in self.table.column_names:
            raise StudyError(f"{name!r:.60} is no column: there are {', '.join(self.table.column_names)}.")
        return self.table.column(name).to_numpy(zero_copy_only=False).astype(float)

    def columns(self) -> dict[str, list[Any]]:
        """All of the table as plain lists; None where a cell has nothing."""
        return self.table.to_pydict()

    def texts(self, name: str) -> list[str]:
        """A column of texts, as status and sentence are."""
        return self.table.column(name).to_pylist()

    @property
    def failed(self) -> dict[int, str]:
        """The cells that failed, and why."""
        rows = zip(*(self.table.column(name).to_pylist() for name in ("cell", "status", "sentence")), strict=True)
        return {cell: sentence for cell, status, sentence in rows if status != "finished"}

    def scenario(self, cell: int) -> Scenario:
        """The scenario of a cell: simulated by itself, for as long, it gives the same metrics. Raises `StudyError`."""
        if isinstance(cell, bool) or not isinstance(cell, (int, np.integer)) or not 0 <= cell < len(self):
            raise StudyError(f"cell = {cell!r:.60} is none: give a whole number from 0 to {len(self) - 1}.")
        return self.plan.cell_scenario(int(cell))

    def to_pandas(self) -> "pandas.DataFrame":
        """The table as a data frame. Raises `StudyError` where pandas is not installed."""
        try:
            return self.table.to_pandas()
        except ImportError:
            raise StudyError("pandas is not installed: pip install pandas brings it, or use .table.") from None

    def plot(self, metric: str = "rms-y") -> "Figure":
        """A metric over what was varied: see `analysis.sweep.figures.draw_metric`."""
        from flexlab.analysis.sweep.figures import draw_metric

        return draw_metric(self, metric)

    def plot_pareto(self, first: str = "rms-y", second: str = "force") -> "Figure":
        """What less of one metric costs in another: see `analysis.sweep.figures.draw_pareto`."""
        from flexlab.analysis.sweep.figures import draw_pareto

        return draw_pareto(self, first, second)

    def __repr__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return (
            f"<Sweep of {len(self)} cells over {', '.join(axis.path for axis in self.axes)}{failed}, in {self.folder}>"
        )

    def _repr_html_(self) -> str:
        """The first rows, for notebooks."""
        rows = ([_text(value) for value in row.values()] for row in self.table.slice(0, HTML_ROWS).to_pylist())
        return f"<p>{escape(repr(self))}</p>{html_table(rows, self.table.column_names)}"


def _text(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
