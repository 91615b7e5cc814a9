"""The leaderboard as files: one HTML file that opens without network, the table, and the figures."""

from pathlib import Path

import pyarrow.csv
import pyarrow.parquet
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from flexlab.analysis.leaderboard.board import Leaderboard
from flexlab.analysis.leaderboard.figures import svg_text, write_figures
from flexlab.analysis.leaderboard.summary import OF_THE_BEST, SEVERAL, overview, provenance, sections, settings
from flexlab.errors import StudyError
from flexlab.recording.store.notes import replacing

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
