"""A sweep's table on disk, one row per cell, saved in parts while it is computed; and the finished sweep.

Each part is written whole or not at all. The plan's key tells whether a folder holds the same sweep.
"""

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property, partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

from flexlab import __version__
from flexlab.analysis.metrics.metric import numbers
from flexlab.analysis.result import Result, named_column, number_column
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.plan import Cell, Plan, run_part
from flexlab.analysis.workers import Told, Workers
from flexlab.arguments import whole_number
from flexlab.compiled import engine
from flexlab.errors import StudyError
from flexlab.files import begin_folder, check_ordinary, read_json, replacing, writable
from flexlab.scenario import Scenario
from flexlab.text import counted, html_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE, PARTS, PLAN = "cells.parquet", "parts", "sweep.json"
"""Names in a sweep's folder: the whole table, the folder of its parts, the plan."""
LARGEST_PLAN = 100_000_000
"""Largest plan that is read, bytes: a list may have very many values."""
METADATA = b"flexlab"
ADVICE = "make room or choose another folder; the parts that are done stay, and the same command goes on from there"
SWEEPS = Path("sweeps")
"""Parent of the default folders of sweeps."""


def sweep_folder(name: str, plan: Plan) -> Path:
    """The default folder of a sweep, the same for the same plan."""
    return SWEEPS / f"{name}-{plan.key}"


def schema(plan: Plan) -> pa.Schema:
    """Columns: number of the cell, each axis by its path, status, sentence, each metric by its name, and the provenance.

    Metrics are in SI units; the columns' metadata hold titles and units. "scenario" is the hash of the cell's scenario.
    """
    axes = [(axis.path, pa.float64() if axis.numeric else pa.string()) for axis in plan.axes]
    shown = ((each.name, {"title": each.column.title, "unit": each.column.si_unit}) for each in numbers())
    metrics = [pa.field(name, pa.float64(), metadata=title_and_unit) for name, title_and_unit in shown]
    about = json.dumps({"sweep": plan.as_data(), "key": plan.key}, ensure_ascii=False, sort_keys=True)
    columns = [("cell", pa.int64()), *axes, ("status", pa.string()), ("sentence", pa.string()), *metrics]
    provenance = [(name, pa.string()) for name in ("scenario", "key", "version")]
    return pa.schema([*columns, *provenance]).with_metadata({METADATA: about.encode()})


def to_table(plan: Plan, cells: Sequence[Cell]) -> pa.Table:
    """The rows of some cells, in their order."""
    nothing, made, layout = (None,) * len(numbers()), (plan.key, __version__), schema(plan)
    rows = []
    for cell in cells:
        found = (cell.status, cell.sentence, *(cell.metrics or nothing), cell.scenario)
        varied = (_plain(value, axis) for value, axis in zip(cell.values, plan.axes, strict=True))
        rows.append((cell.number, *varied, *found, *made))
    columns = zip(zip(*rows, strict=True), layout, strict=True)
    return pa.table([pa.array(column, field.type) for column, field in columns], layout)


def _plain(value: Any, axis: Axis) -> Any:
    """A value as its column holds it: a number where all values of the axis are numbers, else text."""
    if axis.numeric:
        return float(value)
    return value if isinstance(value, str) else json.dumps(value)


def part_file(folder: Path, cells: range) -> Path:
    """The file of a part while the sweep is computed."""
    return folder / PARTS / f"{cells.start:09d}.parquet"


def _rows(file: Path, layout: pa.Schema, cells: range) -> pa.Table:
    """The rows of these cells in a file. Raises OSError, or ValueError for a file that holds anything else."""
    check_ordinary(file)
    try:
        with file.open("rb") as opened:  # Arrow itself opens no file whose name is not UTF-8.
            table = parquet.read_table(opened, partitioning=None)
    except pa.ArrowException as error:
        raise ValueError(str(error)) from None
    if table.schema != layout or not np.array_equal(table.column("cell"), cells):
        raise ValueError("it holds other cells")
    return table


def read_part(folder: Path, plan: Plan, cells: range) -> dict[str, list[Any]] | None:
    """The columns of a part; None if its file is damaged or missing, as before its computation and after the sweep's end."""
    try:
        return _rows(part_file(folder, cells), schema(plan), cells).to_pydict()
    except (OSError, ValueError):
        return None


def save_part(folder: Path, plan: Plan, cells: Sequence[Cell]) -> None:
    """Write a part, whole or not at all. Raises `StudyError`."""
    part = part_file(folder, range(cells[0].number, cells[-1].number + 1))
    with writable(folder, ADVICE):
        part.parent.mkdir(exist_ok=True)  # The same sweep, computed twice at once, may have been finished.
        with replacing(part) as draft, draft.open("wb") as opened:
            parquet.write_table(to_table(plan, cells), opened)


def run_sweep(plan: Plan, folder: Path, workers: Workers, told: Told = lambda done, total: None) -> "Sweep":
    """Compute the missing parts of a sweep in its folder, and return the finished sweep.

    A sweep may be interrupted or killed at any time: the same call then computes the remaining parts, and the table is the
    same, byte for byte. Raises `StudyError`, also for a folder that cannot be written or holds another sweep.
    """
    with writable(folder, ADVICE):
        begin_folder(folder)
        _check_plan(folder, plan)
        (folder / PARTS).mkdir(exist_ok=True)
    if not (folder / TABLE).exists():
        missing = [cells for cells in plan.parts() if read_part(folder, plan, cells) is None]
        done = plan.cell_count - sum(map(len, missing))
        told(done, plan.cell_count)
        with workers() as run:
            # Workers get a copy without the drawn samples, which may be large, and draw the same ones.
            for _, cells in run(partial(run_part, replace(plan)), missing):
                save_part(folder, plan, cells)
                done += len(cells)
                told(done, plan.cell_count)
    join_parts(folder, plan)
    return Sweep(plan, folder)


def _check_plan(folder: Path, plan: Plan) -> None:
    """Write the plan into a new folder; raise `StudyError` if the folder holds another one."""
    file = folder / PLAN
    if not file.exists():
        text = json.dumps({"key": plan.key, **plan.as_data()}, indent=1, ensure_ascii=False)
        with replacing(file) as draft:
            draft.write_text(text + "\n", encoding="utf-8")
    try:
        held = read_json(file, LARGEST_PLAN)
        key, made_by = held["key"], (held["engine"], held.get("version"))
    except (ValueError, KeyError, TypeError):
        key, made_by = None, (engine(), __version__)
    if key == plan.key:
        return
    if made_by == (engine(), __version__):
        raise StudyError(f"{folder} holds another sweep: choose another folder, or move that one away.")
    raise StudyError(
        f"{folder} holds a sweep of another version of flexlab, whose results may differ: choose another folder, or move that "
        "one away."
    )


def join_parts(folder: Path, plan: Plan) -> None:
    """Write the whole table, unless it exists, and remove its parts. Raises `StudyError`."""
    with writable(folder, ADVICE):
        table = folder / TABLE
        if not table.exists():
            layout = schema(plan)
            try:
                with (
                    replacing(table) as draft,
                    draft.open("wb") as opened,
                    parquet.ParquetWriter(opened, layout, compression="zstd") as writer,
                ):
                    for cells in plan.parts():
                        writer.write_table(_rows(part_file(folder, cells), layout, cells))
            except OSError:
                if not table.exists():  # If it exists, the same sweep, computed twice at once, has joined them.
                    raise
        shutil.rmtree(folder / PARTS, ignore_errors=True)


HTML_ROWS = 10
"""Rows of the table that a notebook shows."""


class Sweep(Result):
    """A finished sweep: `table` has a row per cell with its values, status and metrics."""

    def __init__(self, plan: Plan, folder: Path):
        """The sweep of `plan`, whose table is in `folder`."""
        self.plan, self.folder = plan, folder
        self._layout = schema(plan)  # A metric that is declared later is not in the table.

    @cached_property
    def table(self) -> Any:
        """A row per cell: number, varied fields, status, sentence, metrics (SI), hash of the scenario, key and version.

        Raises `StudyError` if its file is damaged.
        """
        file = self.folder / TABLE
        try:
            return _rows(file, self._layout, range(len(self)))
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            damaged = f"{file} is damaged ({' '.join(reason.split()):.100})"
            raise StudyError(f"{damaged}: move it away, and the same sweep computes it again.") from None

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The varied fields."""
        return self.plan.axes

    def __len__(self) -> int:
        return self.plan.cell_count

    def column(self, name: str) -> np.ndarray:
        """A column of numbers, (cells,), SI, NaN where a cell has none; see `number_column`. Raises `StudyError`."""
        return number_column(self.table, name)

    def columns(self) -> dict[str, list[Any]]:
        """The whole table as lists by column; None where a cell has no value."""
        return self.table.to_pydict()

    def texts(self, name: str) -> list[str]:
        """A column of texts, such as "status" or "sentence". Raises `StudyError`."""
        return named_column(self.table, name).to_pylist()

    @property
    def failed(self) -> dict[int, str]:
        """Failed cell → the reason."""
        rows = zip(*(self.table.column(name).to_pylist() for name in ("cell", "status", "sentence")), strict=True)
        return {cell: sentence for cell, status, sentence in rows if status != "finished"}

    def scenario(self, cell: int) -> Scenario:
        """The scenario of a cell; simulated alone for the same time, it gives the same metrics. Raises `StudyError`."""
        return self.plan.cell_scenario(whole_number("cell", cell, 0, len(self) - 1))

    def plot(self, metric: str = "rms_error.y") -> "Figure":
        """A metric over the varied fields; see `analysis.sweep.figures.draw_metric`."""
        from flexlab.analysis.sweep.figures import draw_metric

        return draw_metric(self.plan, self.table, metric)

    def plot_pareto(self, first: str = "rms_error.y", second: str = "rms_internal_force") -> "Figure":
        """The trade-off between two metrics; see `analysis.sweep.figures.draw_pareto`."""
        from flexlab.analysis.sweep.figures import draw_pareto

        return draw_pareto(self.table, first, second)

    def __repr__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        fields = ", ".join(axis.path for axis in self.axes)
        return f"<Sweep of {counted(len(self), 'cell')} over {fields}{failed}, in {self.folder}>"

    def _repr_html_(self) -> str:
        def shown(value: Any) -> str:
            return f"{value:.4g}" if isinstance(value, float) else "–" if value is None else str(value)

        rows = (map(shown, row.values()) for row in self.table.slice(0, HTML_ROWS).to_pylist())
        return f"<p>{escape(repr(self))}</p>{html_table(rows, self.table.column_names)}"
