"""Figures of a sweep's table: each metric over one or two varied fields, and the trade-off between two metrics."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexlab.analysis.figures import (
    BLUE,
    GRAY,
    VERMILION,
    drawable,
    empty_figure,
    number_plainly,
    panels,
    save_figure,
    style,
)
from flexlab.analysis.metrics.metric import named, numbers
from flexlab.analysis.result import number_column
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.plan import Plan
from flexlab.text import in_mathtext

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SIZE = (6.0, 4.2)
"""Inches."""
WIDE_SPREAD = 100.0
"""Ratio of largest to smallest value above which a scale is logarithmic."""
PANELS = 6
"""Most panels in one figure; the title says how many combinations are shown if there are more."""
DEFAULT_PARETO = ("rms_error.y", "rms_internal_force")
NOT_SETTLED = "#d0d0d0"
"""Colour of cells that finished but have no number."""


def write_figures(
    plan: Plan, table: Any, folder: Path, shown: Sequence[str] = (), pareto: Sequence[str] = DEFAULT_PARETO
) -> list[Path]:
    """Write a figure of each metric in `shown` (empty: those in lists of runs), and one of the two in `pareto`, to a folder.

    Returns the paths. Raises `StudyError` for an unknown metric, or a folder that cannot be written.
    """
    listed = [number.name for number in numbers() if number.column.listed]
    figures = {name: draw_metric(plan, table, name) for name in shown or listed}
    figures["pareto"] = draw_pareto(table, *pareto)
    return [save_figure(figure, folder / f"{name}.svg") for name, figure in figures.items()]


def draw_metric(plan: Plan, table: Any, name: str) -> "Figure":
    """A metric over the varied fields: a curve over one field, a heat map over two of a grid, points for sampled cells.

    A field without numbers gets a panel for each value, as does a third numeric field of a grid. Failed cells are crossed out.
    Raises `StudyError`.
    """
    column = named(name).column
    numeric, every = _panels(plan, table)
    shown = every[:PANELS]
    left_out = f", {len(shown)} of {len(every)} combinations" if len(every) > len(shown) else ""
    with style():
        figure, parts = panels(len(shown), *SIZE)
        figure.suptitle(f"{column.label}{left_out}")
        values = drawable(number_column(table, column.key))
        known = values[~np.isnan(values)] if not np.isnan(values).all() else np.array([0.0, 1.0])
        scale = {"norm": _scale(known), "vmin": known.min(), "vmax": known.max()}
        drawn: Any = None
        for part, (title, rows) in zip(parts, shown, strict=True):
            part.set_title(title, fontsize="medium")
            part.set_xlabel(_label(plan, numeric[0]))
            if len(numeric) == 1:
                part.set_ylabel(column.label)
                _draw_curve(part, numeric[0], table, rows, values)
            else:
                part.set_ylabel(_label(plan, numeric[1]))
                drawn = _draw_map(part, numeric, table.take(rows), values[rows], plan.samples is None, scale)
        if drawn is not None:
            number_plainly(figure.colorbar(drawn, ax=parts, label=column.label).ax.yaxis)
    return figure


def draw_pareto(table: Any, first: str, second: str) -> "Figure":
    """Two metrics of all cells; a line joins the cells for which no other cell is smaller in both."""
    one, other = (named(name).column for name in (first, second))
    x, y = (drawable(number_column(table, each.key)) for each in (one, other))
    with style():
        figure = empty_figure(*SIZE)
        axes = figure.add_subplot()
        axes.plot(x, y, "o", color=GRAY, markersize=3, alpha=0.6, label="cell")
        best = pareto_front(x, y)
        axes.step(x[best], y[best], "o-", where="post", color=VERMILION, markersize=4, label="Pareto front")
        axes.set(xscale=_scale(x), yscale=_scale(y))
        number_plainly(axes.xaxis, axes.yaxis)
        axes.set_xlabel(one.label)
        axes.set_ylabel(other.label)
        axes.set_title(
            f"{len(best)} of {int(np.sum(~np.isnan(x + y)))} cells are Pareto-optimal: no other is better in both"
        )
        axes.legend(frameon=False)
    return figure


def pareto_front(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Indices, by rising x, of the cells for which no other cell has both a smaller x and a smaller y; NaN never counts."""
    usable = np.flatnonzero(~np.isnan(x + y))
    order = usable[np.lexsort((y[usable], x[usable]))]
    if len(order) == 0:
        return order
    least = np.minimum.accumulate(y[order])
    return order[np.concatenate([[True], least[1:] < least[:-1]])]


def _panels(plan: Plan, table: Any) -> tuple[list[Axis], list[tuple[str, np.ndarray]]]:
    """The axes to draw along, and a panel, (title, rows), for each combination of the other axes' values."""
    numeric = [axis for axis in plan.axes if axis.numeric and (len(axis.values) > 1 or axis.low is not None)]
    others = [axis for axis in plan.axes if not axis.numeric]
    if not numeric:  # Names are drawn in their order, in place of numbers; a single number is a point.
        numeric, others = [*others, *plan.axes][:1], others[1:]
    if plan.samples is None:  # Cells of a grid that differ only in a third number would overlap.
        numeric, others = numeric[:2], others + numeric[2:]
    found = [("", np.arange(len(table)))]
    for axis in others:
        field, names = axis.path.rpartition(".")[2], np.array(table.column(axis.path).to_pylist(), dtype=object)
        found = [
            (f"{title}  {f'{field} = {value:g}' if axis.numeric else value}".strip(), rows[names[rows] == value])
            for title, rows in found
            for value in dict.fromkeys(names)
        ]
    return numeric, found


def _draw_curve(part: "Axes", axis: Axis, table: Any, rows: np.ndarray, values: np.ndarray) -> None:
    if axis.numeric:
        x = number_column(table, axis.path)
    else:
        names = table.column(axis.path).to_pylist()
        order = list(dict.fromkeys(names))
        x = np.array([order.index(name) for name in names], dtype=float)
        part.set_xticks(range(len(order)), order)
    x, values = x[rows], values[rows]
    shown = np.argsort(x, kind="stable")
    part.plot(x[shown], values[shown], "o-" if axis.numeric else "o", color=BLUE, markersize=3)
    for bad in x[np.isnan(values)]:
        part.axvline(bad, color=GRAY, linestyle=":", linewidth=0.8)
    if axis.logarithmic:
        part.set_xscale("log")
        number_plainly(part.xaxis)


def _draw_map(
    part: "Axes", axes: Sequence[Axis], cells: Any, values: np.ndarray, grid: bool, scale: dict[str, Any]
) -> Any:
    """Draw a heat map over the first two axes; `grid`: whether the cells may be all combinations of their values."""
    across, up = axes[:2]
    x, y = number_column(cells, across.path), number_column(cells, up.path)
    failed = np.array([status != "finished" for status in cells.column("status").to_pylist()])
    part.grid(False)
    part.set_xscale("log" if across.logarithmic else "linear")
    part.set_yscale("log" if up.logarithmic else "linear")
    number_plainly(part.xaxis, part.yaxis)
    if grid and len(across.values) * len(up.values) == len(cells):
        columns, lines = np.unique(x), np.unique(y)
        placed = np.full((len(lines), len(columns)), np.nan)
        placed[np.searchsorted(lines, y), np.searchsorted(columns, x)] = values
        part.set_facecolor(NOT_SETTLED)
        edges = _edges(columns, across.logarithmic), _edges(lines, up.logarithmic)
        drawn = part.pcolormesh(*edges, placed, **scale, cmap="viridis", rasterized=True)
    else:
        drawn = part.scatter(x, y, c=values, **scale, cmap="viridis", s=12)
    if failed.any():
        part.plot(x[failed], y[failed], "x", color=VERMILION, markersize=4, label="failed")
        part.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize="small", frameon=False)
    return drawn


def _edges(centers: np.ndarray, logarithmic: bool) -> np.ndarray:
    """The edges of cells, (n + 1,), from their centres."""
    if len(centers) == 1:
        return np.array([centers[0] * 0.9 - 0.05, centers[0] * 1.1 + 0.05])
    places = np.log(centers) if logarithmic else centers
    between = (places[1:] + places[:-1]) / 2
    edges = np.concatenate([[2 * places[0] - between[0]], between, [2 * places[-1] - between[-1]]])
    return np.exp(edges) if logarithmic else edges


def _scale(values: np.ndarray) -> str:
    """The kind of scale that shows all values; NaN is ignored."""
    known = values[~np.isnan(values)]
    return "log" if len(known) and known.max() > WIDE_SPREAD * max(known.min(), 0) > 0 else "linear"


def _label(plan: Plan, axis: Axis) -> str:
    if not plan.scenario.has(axis.path):
        return axis.path
    about = plan.scenario.about(axis.path)
    symbol = f", {in_mathtext(about.symbol)}" if about.symbol else ""
    return f"{about.title}{symbol}{f' ({about.unit})' if about.unit not in ('', '1') else ''}"
