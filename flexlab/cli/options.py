"""Options that several commands share, described once."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from flexlab.errors import StudyError

if TYPE_CHECKING:
    from flexlab.scenario import Scenario

Preset = Annotated[
    str, tyro.conf.arg(metavar="PRESET", help="A preset's name (see `flexlab presets`) or the path of a scenario file.")
]
Presets = tyro.conf.Positional[
    Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="PRESET [PRESET ...]",
            help="Presets' names (see `flexlab presets`) or paths of scenario files.",
            help_behavior_hint="",
        ),
    ]
]
Settings = Annotated[
    tyro.conf.UseAppendAction[tuple[str, ...]],
    tyro.conf.arg(
        name="set",
        metavar="PATH=VALUE",
        help="Change a field of the scenario, as in controller.feedback_gain=400; as often as you like.",
        help_behavior_hint="",
    ),
]
Law = Annotated[
    str | None,
    tyro.conf.arg(
        metavar="KIND|FILE.py|FILE.fmu|tcp://HOST:PORT",
        help="Another control law: its name, the Python file or unit (.fmu) that holds it, or the address of a program.",
        help_behavior_hint="",
    ),
]
PathChoice = Annotated[
    str | None,
    tyro.conf.arg(
        metavar="KIND|FILE",
        help="Another path, by its name, a CSV file with the columns t, x, y, theta, or the Python file that holds it.",
        help_behavior_hint="",
    ),
]
Seed = Annotated[
    int | None,
    tyro.conf.arg(
        metavar="N", help="Choose the sensor noise: --set controller.sensor_noise.seed=N.", help_behavior_hint=""
    ),
]
Threads = Annotated[
    int | None, tyro.conf.arg(metavar="N", help="Threads. (default: one per core)", help_behavior_hint="")
]
Cluster = Annotated[
    str | None,
    tyro.conf.arg(
        metavar="tcp://HOST:PORT",
        help="Compute on the Dask cluster of this scheduler (needs flexlab[cluster]).",
        help_behavior_hint="",
    ),
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


def chosen_scenarios(
    presets: Sequence[str], settings: Sequence[str], law: str | None, seed: int | None, path: str | None = None
) -> "list[tuple[str, Scenario]]":
    """(short name, scenario with what was set) of each preset. Raises `FlexlabError` before anything is run.

    A law or path in Python runs in a process of its own, which has a time limit; what it prints goes to standard error.
    """
    from flexlab.own import hosts
    from flexlab.own.files import law_kind
    from flexlab.presets import find_scenario
    from flexlab.scenario.path_file import with_path
    from flexlab.scenario.settings import change_settings, settings_from

    if not presets:
        raise StudyError(
            "Say what to simulate: a preset's name, as in flexlab run paper, or a scenario file; see flexlab run --help."
        )
    if law is not None or path is not None:
        hosts.run_apart(output=2)
    changes = settings_from(settings, None if law is None else law_kind(law), seed)
    found = list(map(find_scenario, presets))
    if path is not None:
        found = [(name, with_path(scenario, path)) for name, scenario in found]
    return [(name, change_settings(scenario, changes)) for name, scenario in found]
