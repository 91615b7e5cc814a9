"""Options that several commands share, described once."""

from pathlib import Path
from typing import Annotated

import tyro

Preset = Annotated[
    str, tyro.conf.arg(metavar="PRESET", help="A preset's name (see `flexlab presets`) or the path of a scenario file.")
]
Logs = Annotated[Path, tyro.conf.arg(metavar="FOLDER", help="Where recordings go; made if it is not there.")]
LOGS = Path("logs")
