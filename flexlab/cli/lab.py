"""`flexlab`: the lab in the browser."""

from typing import Annotated

import tyro

from flexlab.cli.options import LOGS, Logs, Preset


def command(
    preset: Preset = "paper",
    host: Annotated[
        str, tyro.conf.arg(metavar="ADDRESS", help="Who may look: this machine only, or 0.0.0.0 for all.")
    ] = "127.0.0.1",
    port: Annotated[int, tyro.conf.arg(metavar="PORT", help="The page's port; 0 takes any free one.")] = 8080,
    no_browser: Annotated[
        bool, tyro.conf.arg(help="Only serve the page; do not open a browser.", help_behavior_hint="")
    ] = False,
    rerun: Annotated[
        bool, tyro.conf.arg(help="Serve the data live to a rerun viewer as well.", help_behavior_hint="")
    ] = False,
    logs: Logs = LOGS,
) -> int:
    """Open the lab: two arms carry a flexible beam, live in your browser, every run recorded.

    Other commands, each with a --help of its own:

      flexlab run PRESET       simulate without a screen, record, print a summary
      flexlab review [FILE]    open a recording, the newest by default
      flexlab presets          list the presets and what to watch in each
      flexlab bench            measure speed and accuracy on this machine
    """
    raise NotImplementedError
