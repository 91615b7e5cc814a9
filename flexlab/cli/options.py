"""Options that several commands share."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import tyro

from flexlab.errors import StudyError
from flexlab.text import shown

if TYPE_CHECKING:
    from flexlab.scenario import Scenario

Several = tyro.conf.UseAppendAction[tuple[str, ...]]
"""An option that may be repeated."""


def option(help: str, metavar: str | None = None, name: str | None = None, default: str | None = "") -> object:
    """An option's help, the form of its value, and its name if Python's differs.

    `default`: the help's words on the default; None for the value itself.
    """
    return tyro.conf.arg(name=name, metavar=metavar, help=help, help_behavior_hint=default)


Preset = Annotated[
    str, option("A preset's name (see `flexlab presets`) or the path of a scenario file.", "PRESET", default=None)
]
Presets = tyro.conf.Positional[
    Annotated[
        tuple[str, ...],
        option("Presets' names (see `flexlab presets`) or paths of scenario files.", "PRESET [PRESET ...]"),
    ]
]
Settings = Annotated[
    Several,
    option(
        "Change a field of the scenario, as in controller.feedback_gain=400; may be repeated.",
        "PATH=VALUE",
        name="set",
    ),
]
Law = Annotated[
    str | None,
    option(
        "Another control law: its name, the Python file or unit (.fmu) that holds it, or the address of a program.",
        "KIND|FILE.py|FILE.fmu|tcp://HOST:PORT",
    ),
]
PathChoice = Annotated[
    str | None,
    option(
        "Another path, by its name, a CSV file with the columns t, x, y, theta, or the Python file that holds it.",
        "KIND|FILE",
    ),
]
Seed = Annotated[int | None, option("Seed of the sensor noise, as --set controller.sensor_noise.seed=N.", "N")]
Threads = Annotated[int | None, option("Number of threads. (default: one per core)", "N")]
Cluster = Annotated[
    str | None, option("Compute on the Dask cluster of this scheduler (needs flexlab[cluster]).", "tcp://HOST:PORT")
]
Logs = Annotated[Path, option("Folder of recordings; created if it does not exist.", "FOLDER", default=None)]
RUN_HELP = "A recording: a file, a run's name in logs or the beginning of one, or newest."
Runs = tyro.conf.Positional[Annotated[tuple[str, ...], option(RUN_HELP, "[RUN ...]")]]
Run = tyro.conf.Positional[Annotated[str, option(RUN_HELP, "[RUN]", default=None)]]
NoBrowser = Annotated[bool, option("Only serve the viewer; do not open a browser.")]
ViewerPort = Annotated[int, option("The viewer's port; 0 takes any free one.", "PORT", default=None)]
LOGS = Path("logs")
NUMBERS = {int: "a whole number", float: "a number, as in 1.5"}
"""What an option of this type needs."""


def check_options(command: Callable[..., Any], words: Sequence[str]) -> None:
    """Raise `StudyError` for an option that is given twice, unless it may be, or whose file has no name or number is none."""
    kinds: dict[str, tuple[Any, ...]] = {}
    repeated = get_args(Several)[1]
    for parameter, hint in get_type_hints(command, include_extras=True).items():
        kind, *about = get_args(hint) or (hint,)
        named = [each.name for each in about if getattr(each, "name", None)]
        kinds["--" + (*named, parameter)[0].replace("_", "-")] = (kind, *about)
    given: set[str] = set()
    for place, word in enumerate(words):
        if word == "--":
            break
        option, equals, value = word.partition("=")
        kind, *about = kinds.get(name := option.replace("_", "-"), (bool,))
        if kind is bool:  # Positional arguments, too.
            continue
        if name in given and repeated not in about:
            raise StudyError(f"{name} is given twice: give it once, as only its last value would count.")
        given.add(name)
        types = kind, *get_args(kind)
        for typed in [value] if equals else words[place + 1 : place + 2]:
            if Path in types and not typed:
                raise StudyError(f"{name} is empty: name a file or folder, or . for this folder.")
            for number, what in NUMBERS.items():
                try:
                    number(typed if number in types else 0)
                except ValueError:
                    raise StudyError(f"{name} {shown(typed)} is not usable: give {what}.") from None


def chosen_scenarios(
    presets: Sequence[str], settings: Sequence[str], law: str | None, seed: int | None, path: str | None = None
) -> "list[tuple[str, Scenario]]":
    """(short name, changed scenario) of each preset. Raises `FlexlabError`."""
    from flexlab.presets import find_scenario
    from flexlab.scenario.path_file import with_path
    from flexlab.scenario.settings import change_settings

    if not presets:
        raise StudyError(
            "Say what to simulate: a preset's name, as in flexlab run paper, or a scenario file; see flexlab run --help."
        )
    changes = chosen_changes(settings, law, seed)
    found = list(map(find_scenario, presets))
    if path is not None:
        found = [(name, with_path(scenario, path)) for name, scenario in found]
    return [(name, change_settings(scenario, changes)) for name, scenario in found]


def chosen_changes(settings: Sequence[str], law: str | None, seed: int | None) -> "dict[str, Any]":
    """The changes of the scenario that these options ask for. Raises `FlexlabError`."""
    from flexlab.own.files import law_kind
    from flexlab.scenario.settings import settings_from

    keep_own_texts_apart()
    return settings_from(settings, None if law is None else law_kind(law), seed)


def check_scenario_file(path: Path) -> None:
    """Check that a scenario can be saved there, and replaces neither a recording nor its notes. Raises `StudyError`."""
    from flexlab.files import check_writing
    from flexlab.recording.store.run_files import SUFFIX

    check_writing(path, ".json")
    if (run := path.with_suffix(SUFFIX)).exists():
        raise StudyError(f"{path} holds the notes on {run.name}: give another name.")


def keep_own_texts_apart() -> None:
    """Run laws and paths in Python in separate processes with time limits; their output goes to standard error."""
    from flexlab.own import hosts

    hosts.run_apart(output=2)
