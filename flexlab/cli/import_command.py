"""`flexlab import FILE`: add an exported run or a recording to logs."""

from pathlib import Path
from typing import Annotated

import tyro

from flexlab.cli.console import note, tell, typed
from flexlab.cli.options import LOGS, Logs, option
from flexlab.cli.warmup import loading


def command(
    file: tyro.conf.Positional[
        Annotated[Path, option("An exported .csv, .parquet or .npz, or a recording.", "FILE", default=None)]
    ],
    logs: Logs = LOGS,
) -> None:
    """Add FILE to logs as a recording with the same samples, bit for bit; FILE itself does not change."""
    with loading():
        from flexlab.analysis.run_summary import note_metrics
        from flexlab.recording.importing import import_into
        from flexlab.recording.store.run_index import read_row

    path = import_into(file, logs)
    note_metrics(path)
    if left_out := read_row(path).note:
        note(left_out)
    run = path.stem if logs == LOGS else path
    tell(f"Recorded in {path}. Look at it with: flexlab review {typed(run)}")
