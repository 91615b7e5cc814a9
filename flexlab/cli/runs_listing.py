"""Listings of recorded runs on the terminal: a line of numbers per run with changes and notes below, or all data of a run."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from flexlab.analysis.metrics.metric import named, numbers
from flexlab.analysis.metrics.run_metrics import DURATION, measured, noted_text, noted_texts, results
from flexlab.cli.console import new_table, note, output, tell
from flexlab.errors import StudyError
from flexlab.recording.store.run_index import RunRow, duration_text, size_text, state_word
from flexlab.text import MISSING, counted

COLUMNS = {number.name: number.column for number in numbers()}
"""Name of a metric → its column."""
FIELDS = tuple(dict.fromkeys(("started", "preset", "duration", "size", "state", *COLUMNS)))
"""Fields by which the table can be sorted."""
CHANGES_SHOWN = 3
"""Most changes of a run that the table shows."""
GAP = "  "


def sorted_rows(rows: Sequence[RunRow], field: str, reverse: bool = False, search: str = "") -> list[RunRow]:
    """The rows that contain all words of `search`, sorted by `field`, newest or smallest first. Raises `StudyError`."""
    with suppress(StudyError):
        field = field if field in FIELDS else named(field).name
    if field not in FIELDS:
        raise StudyError(f"--sort {field} is not a field: choose one of {', '.join(FIELDS)}.")
    words = search.lower().split()
    found = [row for row in rows if all(word in _all_words(row) for word in words)]
    known = [row for row in found if _value(row, field) is not None]
    unknown = [row for row in found if _value(row, field) is None]
    known.sort(key=lambda row: _value(row, field), reverse=field == "started")
    return (known[::-1] if reverse else known) + unknown


def _value(row: RunRow, field: str) -> Any:
    if field in COLUMNS and field != DURATION:
        value = results(row.metrics, row.is_stopped).get(COLUMNS[field].key)
        return value if isinstance(value, (int, float)) else None
    return getattr(row, field)


def _all_words(row: RunRow) -> str:
    started = f"{row.started:%Y-%m-%d %H:%M:%S}"
    words = (row.id, row.preset, started, state_word(row), row.status, row.note, *row.tags, *row.changes)
    return " ".join((*words, "kept" if row.kept else "")).lower()


def plain_row(row: RunRow) -> dict[str, Any]:
    """All data of a run, ready for JSON."""
    return {
        "run": row.id,
        "file": str(row.path),
        "preset": row.preset,
        "started": row.started.isoformat(),
        "begins [s]": row.begins,
        "duration [s]": row.duration,
        "size [B]": row.size,
        "state": state_word(row),
        "problem": row.problem,
        "status": row.status,
        "kept": row.kept,
        "note": row.note,
        "tags": row.tags,
        "changes": row.changes,
        "metrics": results(row.metrics, row.is_stopped),
    }


def print_table(rows: Sequence[RunRow], logs: Path) -> None:
    """Print a line of aligned numbers per run, with changes, note and tags indented below it."""
    from rich.cells import set_cell_size
    from rich.text import Text

    columns, left_out = _columns_with_room(rows)
    widths = list(map(_width, columns))

    def line(texts: Sequence[str]) -> str:
        first, *others = [
            set_cell_size(text, width) if number == 0 else f"{text:>{width}}"
            for number, (text, width) in enumerate(zip(texts, widths, strict=True))
        ]
        return GAP.join((first, *others)).rstrip()

    console = output()
    headings, units, *lines = zip(*columns, strict=True)
    tell(line(headings), line(units), style="bold")
    for row, texts in zip(rows, lines, strict=True):
        tell(line(texts))
        if more := _more(row):
            below = Text(GAP + more, style="dim")
            if console.is_terminal:
                below.truncate(console.width, overflow="ellipsis")
            console.print(below, soft_wrap=True)
    size = size_text(sum(row.size for row in rows))
    note(f"{counted(len(rows), 'run')}, {size}, in {logs}. flexlab logs RUN shows more of one.")
    if left_out:
        note(f"A wider window has room for {', '.join(left_out)}.")
    if missing := sum(not measured(row.metrics) and row.state != "in use" for row in rows):
        note(f"Without metrics: {missing}. flexlab logs --measure reads those that can be read.")


def _width(texts: Sequence[str]) -> int:
    """Terminal columns that the longest of some texts takes."""
    from rich.cells import cell_len

    return max(map(cell_len, texts))


def _columns_with_room(rows: Sequence[RunRow]) -> tuple[list[list[str]], list[str]]:
    """The columns that fit into the window (heading, unit, a text per run), and the headings of the others."""
    columns = [
        ["run", "", *(row.id for row in rows)],
        ["duration", "", *(duration_text(row.duration) for row in rows)],
        ["size", "", *(size_text(row.size) for row in rows)],
        ["state", "", *(state_word(row) for row in rows)],
    ]
    metrics = [
        [metric.heading, metric.unit, *(noted_text(metric, row.metrics, row.is_stopped) for row in rows)]
        for metric in COLUMNS.values()
        if metric.listed
    ]
    # A narrow window leaves out the last columns.
    shown, console = len(metrics), output()
    room = console.width + len(GAP) - sum(_width(column) + len(GAP) for column in columns)
    while console.is_terminal and shown and sum(_width(column) + len(GAP) for column in metrics[:shown]) > room:
        shown -= 1
    return columns + metrics[:shown], [column[0] for column in metrics[shown:]]


def _more(row: RunRow) -> str:
    marks = (["kept"] if row.kept else []) + [f"#{tag}" for tag in row.tags]
    left = len(row.changes) - CHANGES_SHOWN
    changes = "; ".join(row.changes[:CHANGES_SHOWN]) + (f"; {left} more" if left > 0 else "")
    parts = (row.problem, " ".join(marks), " ".join(row.note.split()), changes)
    return " · ".join(part for part in parts if part)


def print_runs(rows: Sequence[RunRow]) -> None:
    """Print all data of some runs."""
    for row in rows:
        table = new_table(show_header=False)
        table.add_column(no_wrap=True)
        table.add_column(overflow="fold")
        lines = [
            ("preset", row.preset),
            ("started", f"{row.started:%Y-%m-%d %H:%M:%S}"),
            ("begins at", f"t = {row.begins:.10g} s" if row.begins else ""),
            ("duration", duration_text(row.duration)),
            ("size", size_text(row.size)),
            (
                "state",
                ", ".join(dict.fromkeys(filter(None, (state_word(row), row.status, "kept" if row.kept else "")))),
            ),
            *((title, text) for title, text in noted_texts(row.metrics, row.is_stopped).items() if text != MISSING),
            ("problem", row.problem),
            ("tags", ", ".join(row.tags)),
            ("note", row.note),
            *(("changed" if number == 0 else "", change) for number, change in enumerate(row.changes)),
            ("file", str(row.path)),
        ]
        for title, text in lines:
            if text:
                table.add_row(title, text)
        tell(row.id, style="bold")
        output().print(table)
