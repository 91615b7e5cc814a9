"""`flexlab review`: look at a recording."""

from pathlib import Path
from typing import Annotated

import tyro

from flexlab.cli.console import output
from flexlab.cli.options import LOGS, Logs
from flexlab.cli.showing import ending, open_browser, wait_for


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
    port: Annotated[int, tyro.conf.arg(metavar="PORT", help="The viewer's port; 0 takes any free one.")] = 0,
    logs: Logs = LOGS,
) -> None:
    """Open a recording in the rerun viewer, in your browser."""
    from flexlab.recording.review import open_review

    with ending() as ended, open_review(file, logs, browser=False, port=port) as review:
        console = output()
        console.print(f"{review.path} is open at", markup=False, soft_wrap=True)
        console.print(review.url, style="bold", markup=False, soft_wrap=True)
        console.print("Ctrl-C ends the viewer's server.")
        if not no_browser:
            open_browser(review.url)
        wait_for(ended)
