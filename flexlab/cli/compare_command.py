"""`flexlab compare`: runs side by side, in tables and laid over each other."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated

import tyro

from flexlab.cli.console import output
from flexlab.cli.options import LOGS, Logs, NoBrowser, Runs, ViewerPort
from flexlab.cli.showing import show_review
from flexlab.errors import StudyError

if TYPE_CHECKING:
    from flexlab.analysis.comparison import Comparison


def command(
    runs: Runs = (),
    save: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="FILE.rrd",
            help="Write the overlay to this file instead of showing it; flexlab review shows it.",
            help_behavior_hint="",
        ),
    ] = None,
    no_browser: NoBrowser = False,
    port: ViewerPort = 0,
    logs: Logs = LOGS,
) -> None:
    """Compare two to six RUNs: what was set differently, what came of it, and all curves in one view.

    Time is counted from each run's first sample. The first RUN is A, to which the others are compared.
    """
    if len(runs) < 2:
        raise StudyError("A comparison needs two runs at least: name them, as in flexlab compare newest 2026-05-01T14.")
    if save is not None and save.suffix != ".rrd":
        raise StudyError(f"--save {save} is no name for a recording: let it end in .rrd.")
    from flexlab.analysis.comparison import compare_into
    from flexlab.recording.store.run_files import find_run

    paths = [find_run(run, logs) for run in runs]
    if save is not None:
        _print(compare_into(paths, save))
        output().print(f"Written to {save}. Look at it with: flexlab review {save}", markup=False, soft_wrap=True)
        return
    with TemporaryDirectory(prefix="flexlab-") as folder:
        target = Path(folder) / "comparison.rrd"
        _print(compare_into(paths, target))
        show_review(target, "The overlay", browser=not no_browser, port=port)


def _print(comparison: "Comparison") -> None:
    from rich.table import Table
    from rich.text import Text

    for heads, *rows in (comparison.run_table(), comparison.metric_table(), comparison.setting_table()):
        table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
        for number, head in enumerate(heads):
            table.add_column(head, justify="right" if number and heads[0] else "left", overflow="fold")
        if heads[0] == "metric":
            output().print(f"Metrics {comparison.window_text}:")
        for row in rows:
            table.add_row(*map(Text, row))
        output().print(table)
        output().print()
    if not comparison.settings:
        output().print("No setting differs.")
    for label, same in comparison.repeated():
        said = f"{label} is the same run as {same}: nothing can differ between them. flexlab logs lists the others."
        output().print(said, soft_wrap=True)
