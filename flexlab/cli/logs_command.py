"""`flexlab logs`: list the recorded runs; note, keep or delete them."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

from flexlab.analysis.metrics.metric import named, numbers
from flexlab.analysis.metrics.run_metrics import DURATION, measured, noted_text, noted_texts, results
from flexlab.cli.console import agreed, new_table, output, print_json, tell
from flexlab.cli.console import note as say
from flexlab.cli.options import LOGS, Logs, Runs, option
from flexlab.cli.warmup import loading
from flexlab.errors import FlexlabError, StudyError
from flexlab.recording.store import run_index
from flexlab.recording.store.run_files import SUFFIX, check_readable, find_run, removable_runs
from flexlab.recording.store.run_index import RunRow, duration_text, read_row, size_text, state_word
from flexlab.text import counted

GIGABYTE = 1e9
COLUMNS = {number.name: number.column for number in numbers()}
"""Name of a metric → its column."""
FIELDS = tuple(dict.fromkeys(("started", "preset", "duration", "size", "state", *COLUMNS)))
"""Fields by which the table can be sorted."""
CHANGES_SHOWN = 3
"""Most changes of a run that the table shows."""
GAP = "  "


def command(
    runs: Runs = (),
    search: Annotated[str, option("List the runs that contain all these words.", "WORDS")] = "",
    sort: Annotated[
        str, option(f"Sort by {', '.join(FIELDS)}: the newest or the smallest first.", "FIELD", default=None)
    ] = "started",
    reverse: Annotated[bool, option("Reverse the order.")] = False,
    as_json: Annotated[bool, option("Print one JSON list, with all metrics.", name="json")] = False,
    note: Annotated[str | None, option("Write a note on RUN; an empty text removes it.", "TEXT")] = None,
    tags: Annotated[str | None, option("Replace RUN's tags with these; an empty text removes them.", "A,B")] = None,
    keep: Annotated[bool, option("Mark RUN so that it is never deleted.")] = False,
    unkeep: Annotated[bool, option("Remove that mark.")] = False,
    delete: Annotated[bool, option("Delete RUN after asking.")] = False,
    max_size: Annotated[
        float | None, option("Delete the oldest runs, after asking, until all together are smaller than this.", "GB")
    ] = None,
    max_age: Annotated[float | None, option("Delete runs older than this, after asking.", "DAYS")] = None,
    yes: Annotated[bool, option("Delete without asking.")] = False,
    measure: Annotated[bool, option("Repair and measure runs that have no metrics yet.")] = False,
    logs: Logs = LOGS,
) -> None:
    """List the recorded runs; look at one; note, tag, keep or delete them.

    Without RUN, prints a table of all runs, newest first; with RUN, all that is known about it. A RUN is a file, a run's name
    or the beginning of one, or newest. Runs are deleted only when you ask for it, and kept ones never.
    """
    limits, edits = max_size is not None or max_age is not None, note is not None or tags is not None or keep or unkeep
    _check(runs, edits=edits, delete=delete, limits=limits, both=keep and unkeep)
    check_readable(logs)
    if not runs and not logs.is_dir():
        raise StudyError(f"There is no folder {logs}: start flexlab, or say where with --logs.")
    if measure:
        _measure(logs)
    if limits:
        _delete(_over_limits(logs, max_size, max_age), yes, "No run is over the limits, apart from kept ones.")
        return
    chosen = [read_row(path) for path in dict.fromkeys(find_run(run, logs) for run in runs)]
    for row in chosen if edits or delete else ():
        if row.path.suffix != SUFFIX:  # Its notes could be another file of yours.
            raise StudyError(
                f"{row.path} does not end in {SUFFIX}: notes, tags, marks and --delete are for recordings."
            )
    if edits:
        for row in chosen:
            run_index.annotate_run(row, note, tags, True if keep else False if unkeep else None)
        chosen = [read_row(row.path) for row in chosen]
    if delete:
        _delete(chosen, yes, "")
        return
    rows = sorted_rows(chosen or run_index.list_rows(logs), sort, reverse, search)
    if as_json:
        print_json([plain_row(row) for row in rows])
    elif chosen and rows:
        print_runs(rows)
    elif rows:
        print_table(rows, logs)
    elif search:
        say(f"No run {'of these' if chosen else f'in {logs}'} has the words {search!r}.")
    else:
        say(f"There is no run in {logs} yet.")


def _check(runs: tuple[str, ...], edits: bool, delete: bool, limits: bool, both: bool) -> None:
    """Raise `StudyError` for options that contradict each other."""
    if both:
        raise StudyError("--keep and --unkeep contradict each other: give one of them.")
    if not runs and (edits or delete):
        what = "--delete" if delete else "--note, --tags, --keep or --unkeep"
        example = f"flexlab logs newest {'--delete' if delete else '--keep'}"
        raise StudyError(f"{what} needs a RUN: say which, as in {example}.")
    if delete and edits:
        raise StudyError("--delete and notes on the same run contradict each other: give one of them.")
    if limits and (runs or edits or delete):
        raise StudyError("--max-size and --max-age choose the runs themselves: give no RUN and nothing else with them.")


def _over_limits(logs: Path, gigabytes: float | None, days: float | None) -> list[RunRow]:
    for name, limit, unit in (("max-size", gigabytes, "GB"), ("max-age", days, "days")):
        if limit is not None and not limit > 0:
            raise StudyError(f"--{name} {limit:g} is not usable: give a number of {unit} above 0.")
    most_bytes = None if gigabytes is None else gigabytes * GIGABYTE
    return list(run_index.read_rows(removable_runs(logs, most_bytes, days)))


def _delete(rows: list[RunRow], yes: bool, nothing: str) -> None:
    """List the runs, ask, and delete them. Raises `RecordingError`, before any is deleted, for a run that must stay."""
    for row in rows:
        run_index.check_removable(row)
    if not rows:
        output().print(nothing)
        return
    for row in rows:
        tell(f"{row.id}  {size_text(row.size)}")
    what = f"{counted(len(rows), 'run')} ({size_text(sum(row.size for row in rows))})"
    if not yes and not agreed(f"Delete {what}? This cannot be undone.", "--yes deletes without asking"):
        output().print("Nothing was deleted.")
        return
    for row in rows:
        run_index.delete_run(row)
    output().print(f"Deleted {what}.")


def _measure(logs: Path) -> None:
    """Repair the recordings of killed labs, and measure every run without metrics."""
    with loading():
        from flexlab.analysis.run_summary import note_missing_metrics
        from flexlab.recording.repair import finish, sweep_empty, unfinished_runs

    if swept := sweep_empty(logs):
        say(f"Removed {counted(swept, 'run')} that ended before anything was written.")
    for path in unfinished_runs(logs):
        try:
            finish(path)
            say(f"Repaired {path.name}.")
        except FlexlabError as error:
            say(str(error))
    say(f"Measured {counted(note_missing_metrics(logs), 'run')}.")


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
    say(f"{counted(len(rows), 'run')}, {size}, in {logs}. flexlab logs RUN shows more of one.")
    if left_out:
        say(f"A wider window has room for {', '.join(left_out)}.")
    if missing := sum(not measured(row.metrics) and row.state != "in use" for row in rows):
        say(f"Without metrics: {missing}. flexlab logs --measure reads those that can be read.")


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
            ("why it stopped", row.why_stopped),
            ("why it breaks off", row.breaks_off),
            *noted_texts(row.metrics, row.is_stopped).items(),
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
