"""Options that several commands share, described once."""

from pathlib import Path
from typing import Annotated

import tyro

Preset = Annotated[
    str, tyro.conf.arg(metavar="PRESET", help="A preset's name (see `flexlab presets`) or the path of a scenario file.")
]
Logs = Annotated[Path, tyro.conf.arg(metavar="FOLDER", help="Where recordings go; made if it is not there.")]
RUN_HELP = "A recording: a file, a run's name in logs or the beginning of one, or newest."
Runs = tyro.conf.Positional[
    Annotated[tuple[str, ...], tyro.conf.arg(metavar="[RUN ...]", help=RUN_HELP, help_behavior_hint="")]
]
Run = tyro.conf.Positional[Annotated[str, tyro.conf.arg(metavar="[RUN]", help=RUN_HELP)]]
NoBrowser = Annotated[bool, tyro.conf.arg(help="Only serve the viewer; do not open a browser.", help_behavior_hint="")]
ViewerPort = Annotated[int, tyro.conf.arg(metavar="PORT", help="The viewer's port; 0 takes any free one.")]
LOGS = Path("logs")
