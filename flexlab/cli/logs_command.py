"""`flexlab logs`: list the recorded runs; note, keep or delete them."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from flexlab.cli.console import agreed, output, print_json, tell
from flexlab.cli.console import note as say
from flexlab.cli.options import LOGS, Logs, Runs, option
from flexlab.cli.runs_listing import FIELDS, plain_row, print_runs, print_table, sorted_rows
from flexlab.cli.warmup import loading
from flexlab.errors import StudyError
from flexlab.text import counted

if TYPE_CHECKING:
    from flexlab.recording.store.run_index import RunRow

GIGABYTE = 1e9


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
    from flexlab.recording.store.run_files import check_readable, find_run
    from flexlab.recording.store.run_index import annotate_run, list_rows, read_row

    limits, edits = max_size is not None or max_age is not None, note is not None or tags is not None or keep or unkeep
    _check(runs, edits=edits, delete=delete, limits=limits, both=keep and unkeep)
    if not runs and not logs.is_dir():
        raise StudyError(f"There is no folder {logs}: start flexlab, or say where with --logs.")
    if measure:
        _measure(logs)
    if limits:
        _delete(_over_limits(logs, max_size, max_age), yes, "No run is over the limits, apart from kept ones.")
        return
    chosen = [read_row(path) for path in dict.fromkeys(find_run(run, logs) for run in runs)]
    if edits:
        for row in chosen:
            annotate_run(row, note, tags, True if keep else False if unkeep else None)
        chosen = [read_row(row.path) for row in chosen]
    if delete:
        _delete(chosen, yes, "")
        return
    rows = sorted_rows(chosen or list_rows(logs), sort, reverse, search)
    if as_json:
        print_json([plain_row(row) for row in rows])
    elif chosen and rows:
        print_runs(rows)
    elif rows:
        print_table(rows, logs)
    elif search:
        say(f"No run {'of these' if chosen else f'in {logs}'} has the words {search!r}.")
    else:
        check_readable(logs)
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


def _over_limits(logs: Path, gigabytes: float | None, days: float | None) -> "list[RunRow]":
    from flexlab.recording.store.run_files import removable_runs
    from flexlab.recording.store.run_index import read_rows

    for name, limit, unit in (("max-size", gigabytes, "GB"), ("max-age", days, "days")):
        if limit is not None and not limit > 0:
            raise StudyError(f"--{name} {limit:g} is not usable: give a number of {unit} above 0.")
    most_bytes = None if gigabytes is None else gigabytes * GIGABYTE
    return list(read_rows(removable_runs(logs, most_bytes, days)))


def _delete(rows: "list[RunRow]", yes: bool, nothing: str) -> None:
    """List the runs, ask, and delete them. Raises `RecordingError`, before any is deleted, for a run that must stay."""
    from flexlab.recording.store.run_index import check_removable, delete_run, size_text

    for row in rows:
        check_removable(row)
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
        delete_run(row)
    output().print(f"Deleted {what}.")


def _measure(logs: Path) -> None:
    """Repair the recordings of killed labs, and measure every run without metrics."""
    with loading():
        from flexlab.analysis.run_summary import note_missing_metrics
        from flexlab.errors import FlexlabError
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
