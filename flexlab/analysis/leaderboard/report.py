"""The tables of a leaderboard for terminal, report and page: an overview, then a section per case.

The report is one HTML file that opens without network.
"""

import re
from math import exp, isnan, log, log2
from pathlib import Path
from typing import Any, NamedTuple

import pyarrow.csv
import pyarrow.parquet
from markupsafe import Markup

from flexlab.analysis.figures import page_svg, svg_text
from flexlab.analysis.leaderboard.board import Leaderboard
from flexlab.analysis.leaderboard.case import Case, Score, Variant
from flexlab.files import filled, make_folder, write_text, writing
from flexlab.scenario.field_text import field_title, in_words
from flexlab.text import number_text, typed_number

FAILS = "fails"
LEVELS = 6
"""Number of shades in a table; each is for scores twice as large as those of the shade before."""
DIGITS = 4
"""Significant digits of a score."""
AS_GOOD = 1.05
"""A score up to this many times the best one counts as the best, too."""
OF_THE_BEST = "times the best law's score"
SEVERAL = "over several scenarios, the geometric mean of these ratios"


class Cell(NamedTuple):
    """A cell of a table."""

    text: str
    level: int | None = None
    """0: the best score of its column; `LEVELS`: 2^LEVELS times the best or more; None: no number."""
    about: str = ""
    """The text that appears when the pointer is on the cell."""


class Grid(NamedTuple):
    """A table with a line per law."""

    heads: tuple[str, ...]
    lines: tuple[tuple[str, tuple[Cell, ...]], ...]
    """(law, cells)."""


class Section(NamedTuple):
    """The tables of one case."""

    case: Case
    main: Grid
    """The ranking score with a column per variant; for a single variant, all scores."""
    details: tuple[tuple[str, Grid], ...]
    """(variant, all scores); empty for a single variant."""
    failures: tuple[str, ...]
    """A sentence for each law that failed."""


def ratios(board: Leaderboard, case: Case, variant: Variant, score: Score) -> dict[str, float]:
    """Each law's score over the best law's; laws without a score are left out."""
    found = {law: board.value(case, variant, law, score) for law in board.laws}
    known = {law: max(value, score.floor) for law, value in found.items() if value is not None}
    best = min(known.values(), default=1.0)
    return {law: value / best for law, value in known.items()}


def _level(ratio: float) -> int:
    return 0 if ratio <= AS_GOOD else min(LEVELS, max(1, round(log2(ratio))))


def _ratio_text(ratio: float) -> str:
    """Three digits, with a thin space between thousands."""
    if ratio >= 999.5:
        return f"{float(f'{ratio:.3g}'):,.0f}".replace(",", "\u202f")
    return _with_zeros(number_text(ratio, 3), 3)


def _with_zeros(text: str, digits: int) -> str:
    """A decimal number padded with zeros to `digits` significant digits, for a column; other texts stay as they are."""
    whole, _, part = text.partition(".")
    known = len(f"{whole}{part}".lstrip("0"))
    if not f"{whole}{part}".isdecimal() or not 0 < known < digits:
        return text
    return f"{whole}.{part}{'0' * (digits - known)}"


def overview(board: Leaderboard) -> Grid:
    """Laws × cases: the main score over the best law's, as the geometric mean over a case's variants."""
    heads = [f"{case.name} {case.title}" for case in board.cases]
    return _grid(heads, [_overview_column(board, case) for case in board.cases], board)


def _overview_column(board: Leaderboard, case: Case) -> dict[str, Cell]:
    by_variant = [ratios(board, case, variant, case.main) for variant in case.variants]
    means: dict[str, float] = {}
    cells: dict[str, Cell] = {}
    for law in board.laws:
        rows = [board.row(case, variant, law) for variant in case.variants]
        entered = [found for row, found in zip(rows, by_variant, strict=True) if row is not None]
        missing = sum(law not in found for found in entered)
        if missing:
            words = "fails" if len(entered) == 1 else f"fails {missing} of {len(entered)}"
            failed = any(row is not None and row.failed for row in rows)
            cells[law] = Cell(words if failed else "no score", None, "see the case")
        elif entered:
            means[law] = exp(sum(log(found[law]) for found in entered) / len(entered))
    best = min(means.values(), default=1.0)
    over_best = {law: mean / best for law, mean in means.items()}
    return cells | {law: Cell(_ratio_text(ratio), _level(ratio), OF_THE_BEST) for law, ratio in over_best.items()}


def sections(board: Leaderboard) -> tuple[Section, ...]:
    """A section per case."""
    return tuple(_section(board, case) for case in board.cases)


def _section(board: Leaderboard, case: Case) -> Section:
    heads, grids = [f"{score.column.heading} ({score.column.unit})" for score in case.scores], list[tuple[str, Grid]]()
    for variant in case.variants:
        all_scores = [_column(board, case, variant, score) for score in case.scores]
        grids.append((variant.name, _grid(heads, all_scores, board)))
    failed = [row for row in board.failed if row.case == case.name]
    failures = tuple(f"{row.law}{f' ({row.variant})' if row.variant else ''}: {row.sentence}" for row in failed)
    if len(case.variants) == 1:
        return Section(case, grids[0][1], (), failures)
    columns = [_column(board, case, variant, case.main) for variant in case.variants]
    return Section(case, _grid([variant.name for variant in case.variants], columns, board), tuple(grids), failures)


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
            text = _with_zeros(score.text(row.scores[score.name]), DIGITS)
            cells[law] = Cell(text, _level(found[law]), said)
    return cells


def settings(board: Leaderboard) -> dict[str, list[str]]:
    """Law → its settings that differ from the defaults, and that it was sampled; laws without any have no entry."""
    parts = ((row.law, part) for row in board.rows for part in BETWEEN.split(_in_words(row.note)))
    found: dict[str, list[str]] = {}
    for law, part in dict.fromkeys(parts):
        if part:
            found.setdefault(law, []).append(part)
    return found


BETWEEN = re.compile("; |(?<!sampled), ")
"""The separators between the settings in a note."""
SETTING = re.compile(r"([a-z_]+(?:\.[a-z_]+)*) = ([^\s;,]+)(?: s\b)?")
"""A field of a law and its value, as rows note them."""


def _in_words(note: str) -> str:
    """A row's note with titles in place of the fields' names."""

    def said(found: re.Match[str]) -> str:
        value = typed_number(found[2])
        path = found[1] if found[1].startswith("controller.") else f"controller.{found[1]}"
        return f"{field_title(path)} = {in_words(found[2]) if isnan(value) else number_text(value)}"

    return SETTING.sub(said, note)


def provenance(board: Leaderboard) -> str:
    """A sentence with the rows' version, engine, seed and machine."""
    names = ("version", "engine", "seed", "machine")
    found = {name: ", ".join(dict.fromkeys(str(getattr(row, name)) for row in board.rows)) for name in names}
    return (
        f"Rows: {len(board.rows)}, of flexlab {found['version']}, engine {found['engine']}, seed {found['seed']}, "
        f"computed on {found['machine']}."
    )


def page_figure(board: Leaderboard, case: Case) -> str:
    """A case's figure as SVG for a page: the same rows give the same text."""
    return page_svg(board.plot(case.name), f"flexlab-{case.name}")


PAGE, TABLE = "leaderboard.html", "leaderboard"


def write_report(board: Leaderboard, folder: Path) -> list[Path]:
    """Write `leaderboard.html`, `.parquet`, `.csv` and a figure per case to a folder; returns the paths. Raises `StudyError`."""
    html, tables = folder / PAGE, [folder / f"{TABLE}.parquet", folder / f"{TABLE}.csv"]
    figures = [folder / f"{case.name}.svg" for case in board.cases]
    make_folder(folder)
    for case, figure in zip(board.cases, figures, strict=True):
        write_text(figure, svg_text(board.plot(case.name), f"flexlab-{case.name}"))
    write_text(html, report_text(board))
    # Arrow itself opens no file whose name is not UTF-8.
    with writing(tables[0]) as draft, draft.open("wb") as opened:
        pyarrow.parquet.write_table(board.table, opened, compression="zstd")
    with writing(tables[1]) as draft, draft.open("wb") as opened:
        pyarrow.csv.write_csv(board.table, opened)
    return [html, *tables, *figures]


def report_text(board: Leaderboard) -> str:
    """The text of the HTML file."""
    figures = {case.name: Markup(page_figure(board, case)) for case in board.cases}
    return filled(Path(__file__).with_name("report.html"), figures=figures, **page_values(board))


def page_values(board: Leaderboard) -> dict[str, Any]:
    """The values that report and page show besides figures."""
    return {
        "overview": overview(board),
        "sections": sections(board),
        "settings": settings(board),
        "provenance": provenance(board),
        "several": SEVERAL,
    }
