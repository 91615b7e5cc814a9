"""The leaderboard as files: one HTML file that opens without network, the table, and the figures.

A figure has a dot per law and scenario, or is a map where there are many scenarios.
"""

import io
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pyarrow.csv
import pyarrow.parquet
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from flexlab.analysis.figures import BLUE, GREEN, STYLE, VERMILION
from flexlab.analysis.leaderboard.board import Leaderboard
from flexlab.analysis.leaderboard.case import Case
from flexlab.analysis.leaderboard.summary import OF_THE_BEST, SEVERAL, overview, provenance, sections, settings
from flexlab.errors import StudyError
from flexlab.recording.store.notes import replacing

WIDTH, LINE, AROUND = 6.5, 0.26, 1.1
"""Inches: of a figure, of a law's line, of what stands above and below."""
MARKS = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"))
"""Of a case's scenarios: told apart by colour and by shape."""
DARK = 0.45
"""Share of the colour scale below which white digits are read more easily than black ones."""


def draw_case(board: Leaderboard, case: Case) -> Figure:
    """The score that ranks, of all laws, less being better, on a logarithmic scale."""
    laws = [law for law in board.laws if any(row.law == law and row.case == case.name for row in board.rows)]
    values = np.array([[_shown(board, case, law, place) for place in range(len(case.variants))] for law in laws])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, AROUND + LINE * max(len(laws), 2)), layout="constrained")
        axes = figure.add_subplot()
        if len(case.variants) <= len(MARKS):
            _draw_dots(axes, case, values)
        else:
            _draw_map(figure, axes, case, values)
        axes.set_yticks(range(len(laws)), laws)
        axes.set_ylim(len(laws) - 0.5, -0.5)
        axes.set_title(f"{case.name}  {case.title}", loc="left", fontsize="medium")
    return figure


def _shown(board: Leaderboard, case: Case, law: str, place: int) -> float:
    row = board.row(case, case.variants[place], law)
    value = None if row is None or row.failed else row.scores.get(case.main.name)
    return np.nan if value is None else case.main.column.scale * max(value, case.main.floor)


def _draw_dots(axes: Axes, case: Case, values: np.ndarray) -> None:
    for place, variant in enumerate(case.variants):
        color, mark = MARKS[place]
        axes.plot(values[:, place], range(len(values)), mark, color=color, markersize=5, label=variant.name)
    for line in np.flatnonzero(np.isnan(values).any(axis=1)):
        axes.annotate(
            "no score" if np.isnan(values[line]).all() else "", (0.99, line), xycoords=("axes fraction", "data"),
            ha="right", va="center", fontsize="small",
        )  # fmt: skip
    if np.isfinite(values).any():
        axes.set_xscale("log")
    axes.grid(axis="x", which="both", alpha=0.2)
    axes.set_xlabel(f"{case.main.column.title} ({case.main.column.unit})")
    if len(case.variants) > 1:
        axes.legend(
            loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(case.variants), frameon=False, fontsize="small"
        )


def _draw_map(figure: Figure, axes: Axes, case: Case, values: np.ndarray) -> None:
    known = values[np.isfinite(values)]
    norm = LogNorm(known.min(), max(known.max(), known.min() * 1.001)) if len(known) else LogNorm(1, 10)
    drawn = axes.imshow(values, norm=norm, cmap="cividis_r", aspect="auto")
    axes.grid(False)
    axes.set_xticks(range(len(case.variants)), [variant.name for variant in case.variants], rotation=30, ha="right")
    for line, place in np.ndindex(*values.shape):
        value = values[line, place]
        dark = np.isfinite(value) and norm(value) > 1 - DARK
        text = f"{value:.2g}" if np.isfinite(value) else "–"
        axes.text(place, line, text, ha="center", va="center", fontsize="x-small", color="white" if dark else "black")
    figure.colorbar(drawn, ax=axes, label=f"{case.main.column.title} ({case.main.column.unit})")


def svg_text(board: Leaderboard, case: Case) -> str:
    """The figure as SVG: the same rows give the same text."""
    with mpl.rc_context(STYLE | {"svg.hashsalt": f"flexlab-{case.name}"}):
        drawn = io.StringIO()
        draw_case(board, case).savefig(drawn, format="svg", metadata={"Date": None})
    svg = drawn.getvalue()
    return svg[svg.index("<svg") :]


def write_figures(board: Leaderboard, folder: Path) -> list[Path]:
    """`<case>.svg` of each case in a folder; returns the paths. Raises `StudyError`."""
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for case in board.cases:
            path = folder / f"{case.name}.svg"
            with replacing(path) as draft:
                draft.write_text(svg_text(board, case), encoding="utf-8")
            paths.append(path)
    except OSError as error:
        raise StudyError(f"{folder} cannot be written ({error.strerror}): choose another folder.") from None
    return paths


PAGE, TABLE = "leaderboard.html", "leaderboard"


def write_report(board: Leaderboard, folder: Path) -> list[Path]:
    """`leaderboard.html`, `.parquet`, `.csv` and a figure per case in a folder; returns the paths. Raises `StudyError`."""
    html = folder / PAGE
    tables = [folder / f"{TABLE}.parquet", folder / f"{TABLE}.csv"]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(html) as draft:
            draft.write_text(report_text(board), encoding="utf-8")
        with replacing(tables[0]) as draft:
            pyarrow.parquet.write_table(board.table, draft, compression="zstd")
        with replacing(tables[1]) as draft:
            pyarrow.csv.write_csv(board.table, draft)
    except OSError as error:
        raise StudyError(f"{folder} cannot be written ({error.strerror}): choose another folder.") from None
    return [html, *tables, *write_figures(board, folder)]


def report_text(board: Leaderboard) -> str:
    """The HTML file's text."""
    folder = Path(__file__).parent
    pages = Environment(loader=FileSystemLoader(folder), autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return pages.get_template("report.html").render(
        overview=overview(board),
        sections=sections(board),
        settings=settings(board),
        provenance=provenance(board),
        of_the_best=OF_THE_BEST,
        several=SEVERAL,
        figures={case.name: Markup(svg_text(board, case)) for case in board.cases},
    )
