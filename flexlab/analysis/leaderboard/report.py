"""What tables, report and page say of a leaderboard: one overview, one section per case, and its figures.

The report is one HTML file that opens without network. A figure has a dot per law and scenario, or is a map where there are many.
"""

import re
from dataclasses import dataclass
from math import exp, isnan, log, log2
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

from flexlab.analysis.figures import BLUE, GREEN, STYLE, VERMILION, page_svg, svg_text
from flexlab.analysis.leaderboard.board import Leaderboard
from flexlab.analysis.leaderboard.case import Case, Score, Variant
from flexlab.analysis.leaderboard.entry import Row
from flexlab.errors import StudyError
from flexlab.recording.store.notes import replacing
from flexlab.scenario.field_text import field_title
from flexlab.text import number_text, typed_number

FAILS = "fails"
LEVELS = 6
"""Shades of a table: each is for a score twice as large as the one before."""
AS_GOOD = 1.05
"""Times the best score up to which a score counts as the best, too."""
OF_THE_BEST = "times the best law's score"
SEVERAL = "of several scenarios the geometric mean"


@dataclass(frozen=True)
class Cell:
    """A number of a table."""

    text: str
    level: int | None = None
    """0: the best of its column; `LEVELS`: 2^LEVELS times as large or more; None: it has no number."""
    about: str = ""
    """More of it, for whoever points there."""


@dataclass(frozen=True)
class Grid:
    """Laws and columns."""

    heads: tuple[str, ...]
    lines: tuple[tuple[str, tuple[Cell, ...]], ...]
    """(law, cells)."""


@dataclass(frozen=True)
class Section:
    """One case."""

    case: Case
    main: Grid
    """The score that ranks, a column per variant; of a single scenario, all scores."""
    details: tuple[tuple[str, Grid], ...]
    """(variant, all scores) where there are several."""
    failures: tuple[str, ...]
    """Sentences."""


def ratios(board: Leaderboard, case: Case, variant: Variant, score: Score) -> dict[str, float]:
    """How many times the best law's score each law's is; laws without a number are not in it."""
    found = {law: _value(board.row(case, variant, law), score) for law in board.laws}
    known = {law: max(value, score.floor) for law, value in found.items() if value is not None}
    best = min(known.values(), default=1.0)
    return {law: value / best for law, value in known.items()}


def _value(row: Row | None, score: Score) -> float | None:
    return None if row is None or row.failed else row.scores.get(score.name)


def _level(ratio: float) -> int:
    return 0 if ratio <= AS_GOOD else min(LEVELS, max(1, round(log2(ratio))))


def _ratio_text(ratio: float) -> str:
    """Three digits, thousands apart."""
    return f"{float(f'{ratio:.3g}'):,.0f}".replace(",", "\u202f") if ratio >= 999.5 else number_text(ratio, 3)


def overview(board: Leaderboard) -> Grid:
    """Laws × cases: how many times the best law's main score, the geometric mean of a case's variants."""
    columns = [_overview_column(board, case) for case in board.cases]
    lines = tuple((law, tuple(column[law] for column in columns)) for law in board.laws)
    return Grid(tuple(f"{case.name} {case.title}" for case in board.cases), lines)


def _overview_column(board: Leaderboard, case: Case) -> dict[str, Cell]:
    by_variant = [ratios(board, case, variant, case.main) for variant in case.variants]
    means: dict[str, float] = {}
    cells: dict[str, Cell] = {}
    for law in board.laws:
        entered = [
            found for variant, found in zip(case.variants, by_variant, strict=True) if board.row(case, variant, law)
        ]
        missing = sum(law not in found for found in entered)
        if not entered:
            cells[law] = Cell("–", None, "does not enter")
        elif missing:
            words = "fails" if len(entered) == 1 else f"fails {missing} of {len(entered)}"
            cells[law] = Cell(words if _failed(board, case, law) else "no score", None, "see the case")
        else:
            means[law] = exp(sum(log(found[law]) for found in entered) / len(entered))
    best = min(means.values(), default=1.0)
    return cells | {
        law: Cell(_ratio_text(mean / best), _level(mean / best), OF_THE_BEST) for law, mean in means.items()
    }


def _failed(board: Leaderboard, case: Case, law: str) -> bool:
    return any((row := board.row(case, variant, law)) is not None and row.failed for variant in case.variants)


def sections(board: Leaderboard) -> tuple[Section, ...]:
    """One per case."""
    return tuple(_section(board, case) for case in board.cases)


def _section(board: Leaderboard, case: Case) -> Section:
    grids = tuple((variant.name, _all_scores(board, case, variant)) for variant in case.variants)
    failures = tuple(_failure(row) for row in board.failed if row.case == case.name)
    if len(case.variants) == 1:
        return Section(case, grids[0][1], (), failures)
    columns = [_column(board, case, variant, case.main) for variant in case.variants]
    return Section(case, _grid([variant.name for variant in case.variants], columns, board), grids, failures)


def _all_scores(board: Leaderboard, case: Case, variant: Variant) -> Grid:
    heads = [f"{score.column.heading} ({score.column.unit})" for score in case.scores]
    return _grid(heads, [_column(board, case, variant, score) for score in case.scores], board)


def _grid(heads: list[str], columns: list[dict[str, Cell]], board: Leaderboard) -> Grid:
    entered = [law for law in board.laws if any(law in column for column in columns)]
    lines = ((law, tuple(column.get(law, Cell("–", None, "does not enter")) for column in columns)) for law in entered)
    return Grid(tuple(heads), tuple(lines))


def _column(board: Leaderboard, case: Case, variant: Variant, score: Score) -> dict[str, Cell]:
    found, cells = ratios(board, case, variant, score), dict[str, Cell]()
    for law in board.laws:
        row = board.row(case, variant, law)
        if row is None:
            continue
        if row.failed:
            cells[law] = Cell(FAILS, None, row.sentence)
        elif law not in found:
            cells[law] = Cell(score.text(None), None, row.sentence)
        else:
            times = f"{_ratio_text(found[law])} {OF_THE_BEST}"
            said = "; ".join(filter(None, (times, _in_words(row.note), row.sentence)))
            cells[law] = Cell(score.text(row.scores[score.name]), _level(found[law]), said)
    return cells


def _failure(row: Row) -> str:
    where = f" ({row.variant})" if row.variant else ""
    return f"{row.law}{where}: {row.sentence}"


def settings(board: Leaderboard) -> tuple[str, ...]:
    """Laws whose settings are not their defaults, or that need a clock, as sentences."""
    notes = dict.fromkeys((row.law, part) for row in board.rows for part in _in_words(row.note).split("; ") if part)
    by_law: dict[str, list[str]] = {}
    for law, part in notes:
        by_law.setdefault(law, []).append(part)
    return tuple(f"{law}: {', '.join(parts)}" for law, parts in by_law.items())


SETTING = re.compile(r"([a-z_]+(?:\.[a-z_]+)*) = ([^\s;,]+)(?: s\b)?")
"""A field of a law and its value, as rows note them."""


def _in_words(note: str) -> str:
    """A row's note with the titles of the fields that it names."""

    def said(found: re.Match[str]) -> str:
        value = typed_number(found[2])
        path = found[1] if found[1].startswith("controller.") else f"controller.{found[1]}"
        return f"{field_title(path)} = {found[2] if isnan(value) else number_text(value)}"

    return SETTING.sub(said, note)


def provenance(board: Leaderboard) -> str:
    """Version, engine, seed and machine of the rows, as a sentence."""
    names = ("version", "engine", "seed", "machine")
    found = {name: ", ".join(dict.fromkeys(str(getattr(row, name)) for row in board.rows)) for name in names}
    return (
        f"{len(board.rows)} rows of flexlab {found['version']}, engine {found['engine']}, seed {found['seed']}, "
        f"computed on {found['machine']}."
    )


WIDTH, LINE, AROUND = 6.5, 0.26, 1.1
"""Inches: of a figure, of a law's line, of what stands above and below."""
BESIDE = 0.15
"""Inches left and right: a law's name may be longer in the language of the page."""
ABOVE_LEGEND = 20
"""Points between a figure's axes and its title."""
MARKS = ((BLUE, "o"), (VERMILION, "s"), (GREEN, "^"))
"""Of a case's scenarios: told apart by colour and by shape."""
INK = "#1c2430"
"""Of digits on light shades, in dark mode too."""
DARK = 0.45
"""Share of the colour scale below which white digits are read more easily than black ones."""


def draw_case(board: Leaderboard, case: Case) -> Figure:
    """The score that ranks, of all laws, less being better, on a logarithmic scale."""
    laws = [law for law in board.laws if any(row.law == law and row.case == case.name for row in board.rows)]
    values = np.array([[_shown(board, case, law, place) for place in range(len(case.variants))] for law in laws])
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH, AROUND + LINE * max(len(laws), 2)))
        figure.set_layout_engine("constrained", w_pad=BESIDE)
        axes = figure.add_subplot()
        if len(case.variants) <= len(MARKS):
            _draw_dots(axes, case, values)
        else:
            _draw_map(figure, axes, case, values)
        axes.set_yticks(range(len(laws)), laws)
        axes.set_ylim(len(laws) - 0.5, -0.5)
        above = ABOVE_LEGEND if 1 < len(case.variants) <= len(MARKS) else None
        axes.set_title(f"{case.name}  {case.title}", loc="left", fontsize="medium", pad=above)
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
        text, color = "–", "black"  # Where no shade is, the page's colour.
        if np.isfinite(value):
            text, color = number_text(value, 2), "white" if norm(value) > 1 - DARK else INK
        axes.text(place, line, text, ha="center", va="center", fontsize="x-small", color=color)
    figure.colorbar(drawn, ax=axes, label=f"{case.main.column.title} ({case.main.column.unit})")


def page_figure(board: Leaderboard, case: Case) -> str:
    """The figure as SVG in a page: the same rows give the same text."""
    return page_svg(draw_case(board, case), _salt(case))


def _salt(case: Case) -> str:
    return f"flexlab-{case.name}"


def write_figures(board: Leaderboard, folder: Path) -> list[Path]:
    """`<case>.svg` of each case in a folder; returns the paths. Raises `StudyError`."""
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for case in board.cases:
            path = folder / f"{case.name}.svg"
            with replacing(path) as draft:
                draft.write_text(svg_text(draw_case(board, case), _salt(case)), encoding="utf-8")
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
        figures={case.name: Markup(page_figure(board, case)) for case in board.cases},
    )
