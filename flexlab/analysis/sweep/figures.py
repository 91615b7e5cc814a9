"""What a sweep looks like: each metric over one or two varied fields, and what one metric costs in another."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure

from flexlab.analysis.figures import BLUE, FORMATS, GRAY, RESOLUTION, STYLE, VERMILION
from flexlab.analysis.metrics import Column
from flexlab.analysis.metrics.metric import named, numbers
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.result import Sweep
from flexlab.errors import StudyError
from flexlab.recording.store.notes import replacing

SIZE = (6.0, 4.2)
"""Inches."""
WIDE_SPREAD = 100.0
"""Largest over least value from which a colour scale is logarithmic."""
PANELS = 6
"""Most panels of one figure: one for each value of a field that is no number."""
DEFAULT_PARETO = ("rms_error.y", "rms_internal_force")
NOT_SETTLED = "#d0d0d0"
"""Of cells that ran but have no number."""


def metric_column(name: str) -> Column:
    """How a metric is shown that is named as in "rms_error.x", or by an earlier name. Raises `StudyError`."""
    return named(name).number.column


def write_figures(
    sweep: Sweep, shown: Sequence[str] = (), pareto: Sequence[str] = DEFAULT_PARETO, kind: str = "svg"
) -> list[Path]:
    """Draw each metric of `shown` (none named: those that lists show) and the two of `pareto` into the sweep's folder."""
    if kind not in FORMATS:
        raise StudyError(f"figures are written as {' or '.join(FORMATS)}, not as {kind!r:.60}.")
    listed = [number.name for number in numbers() if number.column.listed]
    figures = {name: draw_metric(sweep, name) for name in shown or listed}
    figures["pareto"] = draw_pareto(sweep, *pareto)
    paths = []
    try:
        for name, figure in figures.items():
            path = sweep.folder / f"{name}.{kind}"
            with replacing(path) as draft, mpl.rc_context(STYLE):
                figure.savefig(draft, dpi=RESOLUTION, format=kind, metadata={"Date": None} if kind == "svg" else None)
            paths.append(path)
    except OSError as error:
        raise StudyError(f"The figures cannot be written to {sweep.folder} ({error.strerror}): make room.") from None
    return paths


def draw_metric(sweep: Sweep, name: str) -> Figure:
    """A metric over the varied fields: a curve over one, a heat map over two of a grid, points for sampled cells.

    A field that is no number gets a panel for each value. Cells that failed are crossed out. Raises `StudyError`.
    """
    column = metric_column(name)
    numeric, panels = _panels(sweep)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(SIZE[0] * min(len(panels), 2), SIZE[1] * -(-len(panels) // 2)), layout="constrained")
        parts = figure.subplots(-(-len(panels) // 2), min(len(panels), 2), squeeze=False).ravel()
        for spare in parts[len(panels) :]:
            spare.set_axis_off()
        figure.suptitle(f"{column.title} ({column.unit})")
        values = sweep.column(column.key)
        scale = _color_scale(values)
        drawn: Any = None
        for part, (title, rows) in zip(parts, panels, strict=False):
            part.set_title(title, fontsize="medium")
            if len(numeric) == 1:
                _draw_curve(part, sweep, numeric[0], values, rows, column)
            else:
                drawn = _draw_map(part, sweep, numeric[0], numeric[1], values, rows, scale) or drawn
        if drawn is not None:
            figure.colorbar(drawn, ax=list(parts), label=f"{column.title} ({column.unit})")
    return figure


def draw_pareto(sweep: Sweep, first: str, second: str) -> Figure:
    """Two metrics of all cells, less being better of both; the cells that no other one betters in both are joined."""
    one, other = metric_column(first), metric_column(second)
    x, y = sweep.column(one.key), sweep.column(other.key)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=SIZE, layout="constrained")
        axes = figure.add_subplot()
        axes.plot(x, y, "o", color=GRAY, markersize=3, alpha=0.6, label="cell")
        best = pareto_front(x, y)
        axes.step(x[best], y[best], "o-", where="post", color=VERMILION, markersize=4, label="bettered by none")
        if len(best) and np.nanmax(x) > WIDE_SPREAD * max(np.nanmin(x), 0) > 0:
            axes.set_xscale("log")
        if len(best) and np.nanmax(y) > WIDE_SPREAD * max(np.nanmin(y), 0) > 0:
            axes.set_yscale("log")
        axes.set_xlabel(f"{one.title} ({one.unit})")
        axes.set_ylabel(f"{other.title} ({other.unit})")
        axes.set_title(f"{len(best)} of {int(np.sum(~np.isnan(x + y)))} cells are bettered by none in both")
        axes.legend(frameon=False)
    return figure


def pareto_front(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Numbers of the cells, by rising x, of which no other one has both a smaller x and a smaller y; NaN never counts."""
    usable = np.flatnonzero(~np.isnan(x + y))
    order = usable[np.lexsort((y[usable], x[usable]))]
    if len(order) == 0:
        return order
    least = np.minimum.accumulate(y[order])
    return order[np.concatenate([[True], least[1:] < least[:-1]])]


def _panels(sweep: Sweep) -> tuple[list[Axis], list[tuple[str, np.ndarray]]]:
    """The axes that are numbers, and (title, rows) for each combination of the values of the others."""
    numeric = [axis for axis in sweep.axes if axis.numeric and (len(axis.values) > 1 or axis.low is not None)]
    others = [axis for axis in sweep.axes if not axis.numeric]
    if not numeric:
        # Names alone: their order takes the place of a number.
        return [others[0]], _split_rows(sweep, others[1:])
    return numeric, _split_rows(sweep, others)


def _split_rows(sweep: Sweep, axes: Sequence[Axis]) -> list[tuple[str, np.ndarray]]:
    found = [("", np.arange(len(sweep)))]
    for axis in axes:
        names = np.array(sweep.table.column(axis.path).to_pylist(), dtype=object)
        found = [
            (f"{title}  {value}".strip(), rows[names[rows] == value])
            for title, rows in found
            for value in dict.fromkeys(names)
        ]
    return found[:PANELS]


def _draw_curve(part: Axes, sweep: Sweep, axis: Axis, values: np.ndarray, rows: np.ndarray, column: Column) -> None:
    if axis.numeric:
        x = sweep.column(axis.path)[rows]
    else:
        names = sweep.table.column(axis.path).to_pylist()
        order = list(dict.fromkeys(names))
        x = np.array([order.index(names[row]) for row in rows], dtype=float)
        part.set_xticks(range(len(order)), order)
    shown = np.argsort(x, kind="stable")
    part.plot(x[shown], values[rows][shown], "o-" if axis.numeric else "o", color=BLUE, markersize=3)
    for bad in x[np.isnan(values[rows])]:
        part.axvline(bad, color=GRAY, linestyle=":", linewidth=0.8)
    if axis.logarithmic:
        part.set_xscale("log")
    part.set_xlabel(_label(sweep, axis))
    part.set_ylabel(f"{column.title} ({column.unit})")


def _draw_map(
    part: Axes, sweep: Sweep, across: Axis, up: Axis, values: np.ndarray, rows: np.ndarray, scale: Normalize
) -> Any:
    x, y, z = sweep.column(across.path)[rows], sweep.column(up.path)[rows], values[rows]
    failed = np.array([status != "finished" for status in sweep.table.column("status").to_pylist()])[rows]
    part.grid(False)
    part.set_xscale("log" if across.logarithmic else "linear")
    part.set_yscale("log" if up.logarithmic else "linear")
    part.set_xlabel(_label(sweep, across))
    part.set_ylabel(_label(sweep, up))
    if sweep.is_grid and len(across.values) * len(up.values) == len(rows):
        columns, lines = np.unique(x), np.unique(y)
        grid = np.full((len(lines), len(columns)), np.nan)
        grid[np.searchsorted(lines, y), np.searchsorted(columns, x)] = z
        part.set_facecolor(NOT_SETTLED)
        edges = _edges(columns, across.logarithmic), _edges(lines, up.logarithmic)
        drawn = part.pcolormesh(*edges, grid, norm=scale, cmap="viridis", rasterized=True)
    else:
        drawn = part.scatter(x, y, c=z, norm=scale, cmap="viridis", s=12)
    if failed.any():
        part.plot(x[failed], y[failed], "x", color=VERMILION, markersize=4, label="failed")
        part.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), fontsize="small", frameon=False)
    return drawn


def _edges(centers: np.ndarray, logarithmic: bool) -> np.ndarray:
    """Borders between cells, (n + 1,), of their centres."""
    if len(centers) == 1:
        return np.array([centers[0] * 0.9 - 0.05, centers[0] * 1.1 + 0.05])
    places = np.log(centers) if logarithmic else centers
    between = (places[1:] + places[:-1]) / 2
    edges = np.concatenate([[2 * places[0] - between[0]], between, [2 * places[-1] - between[-1]]])
    return np.exp(edges) if logarithmic else edges


def _color_scale(values: np.ndarray) -> Normalize:
    known = values[~np.isnan(values)]
    if len(known) and known.min() > 0 and known.max() > WIDE_SPREAD * known.min():
        return LogNorm(known.min(), known.max())
    return Normalize(known.min(initial=0.0) if not len(known) else known.min(), known.max() if len(known) else 1.0)


def _label(sweep: Sweep, axis: Axis) -> str:
    if not sweep.plan.scenario.has(axis.path):
        return axis.path
    about = sweep.plan.scenario.about(axis.path)
    symbol = f", {about.symbol}" if about.symbol else ""
    return f"{about.title}{symbol}{f' ({about.unit})' if about.unit not in ('', '1') else ''}"
