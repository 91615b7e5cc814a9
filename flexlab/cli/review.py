"""`flexlab review`: look at a recording."""

from pathlib import Path
from typing import Annotated

import tyro

from flexlab.cli.options import LOGS, Logs


def command(
    file: tyro.conf.Positional[
        Annotated[
            Path | None,
            tyro.conf.arg(metavar="[FILE]", help="A recording (.rrd); the newest if left out.", help_behavior_hint=""),
        ]
    ] = None,
    no_browser: Annotated[
        bool, tyro.conf.arg(help="Only serve the viewer; do not open a browser.", help_behavior_hint="")
    ] = False,
    logs: Logs = LOGS,
) -> int:
    """Open a recording in the rerun viewer, in your browser."""
    raise NotImplementedError
