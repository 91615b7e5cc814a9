"""The table of a sweep, and a finished sweep as Python users get it.

One row per cell, saved part by part under a key of what the table holds, whole or not at all.
"""

import json
import shutil
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

from flexlab.analysis.metrics.metric import named, numbers
from flexlab.analysis.result import Result, about_number
from flexlab.analysis.sweep.axes import Axis
from flexlab.analysis.sweep.plan import Cell, Plan, run_part
from flexlab.analysis.workers import Told, Workers
from flexlab.errors import StudyError
from flexlab.recording.run_info import package_version
from flexlab.recording.store.notes import replacing
from flexlab.scenario import Scenario
from flexlab.text import html_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE, PARTS, PLAN = "cells.parquet", "parts", "sweep.json"
"""In a sweep's folder: the whole table; what there is of it while it is computed; what was asked for."""
METADATA = b"flexlab"
SWEEPS = Path("sweeps")
"""Where sweeps go that name no folder."""


def sweep_folder(name: str, plan: Plan) -> Path:
    """The folder of a sweep that names none: the same sweep finds it again."""
    return SWEEPS / f"{name}-{plan.key}"


def schema(plan: Plan) -> pa.Schema:
    """Columns: the cell's number, each axis by its path, status, sentence, each metric by its name, and where it all comes from.

    Metrics are in SI units; the columns' metadata have titles and units. "scenario" is the cell's own, as a hash.
    """
    axes = [(axis.path, pa.float64() if axis.numeric else pa.string()) for axis in plan.axes]
    metrics = [pa.field(each.name, pa.float64(), metadata=about_number(each)) for each in numbers()]
    about = json.dumps({"sweep": plan.as_data(), "key": plan.key}, ensure_ascii=False, sort_keys=True)
    columns = [("cell", pa.int64()), *axes, ("status", pa.string()), ("sentence", pa.string()), *metrics]
    provenance = [(name, pa.string()) for name in ("scenario", "key", "version")]
    return pa.schema([*columns, *provenance]).with_metadata({METADATA: about.encode()})


def to_table(plan: Plan, cells: Sequence[Cell]) -> pa.Table:
    """Rows of some cells, in their order."""
    nothing = (None,) * len(numbers())
    version = package_version()
    rows = [
        (
            cell.number,
            *map(_plain, cell.values),
            cell.status,
            cell.sentence,
            *(cell.metrics or nothing),
            cell.scenario,
            plan.key,
            version,
        )
        for cell in cells
    ]
    layout = schema(plan)
    return pa.table(
        [pa.array(column, field.type) for column, field in zip(zip(*rows, strict=True), layout, strict=True)], layout
    )


def _plain(value: Any) -> Any:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value)
    return value if isinstance(value, str) else json.dumps(value)


def part_file(folder: Path, cells: range) -> Path:
    """Where some cells of a sweep lie while it is computed."""
    return folder / PARTS / f"{cells.start:09d}.parquet"


def read_part(folder: Path, plan: Plan, cells: range) -> dict[str, list[Any]] | None:
    """Columns of some cells of a sweep that is being computed; None: they are not there (yet, or any more)."""
    try:
        return parquet.read_table(part_file(folder, cells), schema=schema(plan)).to_pydict()
    except OSError:
        return None


class SweepFolder:
    """A sweep's folder. All methods raise `StudyError` if it cannot be written or holds another sweep."""

    def __init__(self, path: Path, plan: Plan):
        """Make the folder, or take up the one that holds a part of the same sweep."""
        self.path, self._plan = path, plan
        try:
            (path / PARTS).mkdir(parents=True, exist_ok=True)
            self._check_plan(path / PLAN)
        except OSError as error:
            raise self._full(error) from None

    def _check_plan(self, file: Path) -> None:
        if not file.exists():
            text = json.dumps({"key": self._plan.key, **self._plan.as_data()}, indent=1, ensure_ascii=False)
            with replacing(file) as draft:
                draft.write_text(text + "\n", encoding="utf-8")
        try:
            held = json.loads(file.read_text(encoding="utf-8"))["key"]
        except (ValueError, KeyError, TypeError):
            held = None
        if held != self._plan.key:
            raise StudyError(f"{self.path} holds another sweep: choose another folder, or move that one away.")

    def _full(self, error: OSError) -> StudyError:
        return StudyError(
            f"{self.path} cannot be written ({error.strerror}): make room or choose another folder; the parts that are "
            "done stay, and the same command goes on from there."
        )

    @property
    def table(self) -> Path:
        """The whole table, once all is done."""
        return self.path / TABLE

    @property
    def is_done(self) -> bool:
        """Whether the whole table is there."""
        return self.table.exists()

    def missing(self) -> list[range]:
        """The parts that are not there yet."""
        return [cells for cells in self._plan.parts() if not self._part(cells).exists()]

    def save(self, cells: Sequence[Cell]) -> None:
        """Save a part, whole or not at all."""
        first = cells[0].number
        try:
            with replacing(self._part(range(first, first + len(cells)))) as draft:
                parquet.write_table(to_table(self._plan, cells), draft)
        except OSError as error:
            raise self._full(error) from None

    def finish(self) -> None:
        """Make the whole table of its parts, which then go."""
        try:
            if not self.is_done:
                with (
                    replacing(self.table) as draft,
                    parquet.ParquetWriter(draft, schema(self._plan), compression="zstd") as writer,
                ):
                    for part in self._tables():
                        writer.write_table(part)
            shutil.rmtree(self.path / PARTS, ignore_errors=True)
        except OSError as error:
            raise self._full(error) from None

    def _tables(self) -> Iterable[pa.Table]:
        for cells in self._plan.parts():
            yield parquet.read_table(self._part(cells), schema=schema(self._plan))

    def _part(self, cells: range) -> Path:
        return part_file(self.path, cells)


HTML_ROWS = 10
"""Rows of the table in a notebook."""


def run_sweep(plan: Plan, folder: Path, workers: Workers, told: Told = lambda done, total: None) -> Path:
    """Compute what is missing of a sweep in its folder; the table's path. Raises `StudyError`.

    May be interrupted or killed at any time: the same call goes on with the parts that are not done, and the table is the
    same, byte for byte.
    """
    kept = SweepFolder(folder, plan)
    if not kept.is_done:
        missing = kept.missing()
        done = plan.cell_count - sum(map(len, missing))
        told(done, plan.cell_count)
        with workers() as run:
            # A copy without what the plan has worked out: drawn samples may be large, and a worker draws the same ones.
            for _, cells in run(partial(run_part, replace(plan)), missing):
                kept.save(cells)
                done += len(cells)
                told(done, plan.cell_count)
    kept.finish()
    return kept.table


class Sweep(Result):
    """A scenario with some fields varied: `table` has a row per cell, with its values, its status and its metrics."""

    def __init__(self, plan: Plan, folder: Path):
        """The finished sweep of a plan in its folder."""
        self.plan, self.folder = plan, folder

    @cached_property
    def table(self) -> pa.Table:
        """All cells: number, varied fields by path, status, sentence, metrics by name, SI; scenario (hash), key and version."""
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
        """A column of numbers, (cells,), SI; NaN where a cell has none. Raises `StudyError`.

        Metrics are named as in "rms_error.y"; by their short names of earlier versions they come in the units of tables.
        """
        scale = 1.0
        if name not in self.table.column_names:
            with suppress(StudyError):
                found = named(name)
                name, scale = found.number.name, found.scale
        if name not in self.table.column_names:
            raise StudyError(f"{name!r:.60} is no column: there are {', '.join(self.table.column_names)}.")
        return scale * self.table.column(name).to_numpy(zero_copy_only=False).astype(float)

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

    def plot(self, metric: str = "rms_error.y") -> "Figure":
        """A metric over what was varied: see `analysis.sweep.figures.draw_metric`."""
        from flexlab.analysis.sweep.figures import draw_metric

        return draw_metric(self, metric)

    def plot_pareto(self, first: str = "rms_error.y", second: str = "rms_internal_force") -> "Figure":
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
