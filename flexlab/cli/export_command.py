"""`flexlab export`: a run's signals as a table, the paper's figures of it."""

from pathlib import Path
from typing import Annotated

import tyro

from flexlab.cli.console import output
from flexlab.cli.options import LOGS, Logs, Run
from flexlab.errors import StudyError


def command(
    run: Run = "newest",
    to: Annotated[
        Path | None,
        tyro.conf.arg(metavar="FILE", help="Table to write: .csv, .parquet or .npz (NumPy).", help_behavior_hint=""),
    ] = None,
    figures: Annotated[
        str | None,
        tyro.conf.arg(
            metavar="PNG|SVG", help="Draw the paper's Figures 2 to 5, beside FILE or here.", help_behavior_hint=""
        ),
    ] = None,
    start: Annotated[
        float | None, tyro.conf.arg(metavar="S", help="Leave out what is earlier, s.", help_behavior_hint="")
    ] = None,
    end: Annotated[
        float | None, tyro.conf.arg(metavar="S", help="Leave out what is later, s.", help_behavior_hint="")
    ] = None,
    logs: Logs = LOGS,
) -> None:
    """Write all signals of RUN as a table, or its figures, or both.

    Columns say their units; SI throughout. Scenario, seed and every command go along, so that `flexlab import` makes of a
    table the same run again, bit for bit.
    """
    if to is None and figures is None:
        raise StudyError("Say what to write: --to FILE.csv (or .parquet, .npz), --figures png or svg, or both.")
    from flexlab.recording.store.run_files import find_run

    path = find_run(run, logs)
    if to is not None:
        from flexlab.recording.export import export_recording
        from flexlab.recording.reader import read_blocks, read_recording
        from flexlab.recording.store.run_index import size_text

        export_recording(read_recording(path, with_samples=False), to, start, end, read_blocks(path))
        output().print(f"{to}  {size_text(to.stat().st_size)}", markup=False, soft_wrap=True)
    if figures is not None:
        from flexlab.analysis.figures import paper_figures
        from flexlab.recording.reader import read_range

        folder = Path() if to is None else to.parent
        samples = read_range(path, start, end)
        for figure in paper_figures(samples, folder, [figures.lower()], name=path.stem):
            output().print(str(figure), markup=False, soft_wrap=True)
