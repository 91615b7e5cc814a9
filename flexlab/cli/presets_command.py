"""`flexlab presets`: list the presets with what to watch in each."""

from typing import TYPE_CHECKING, Annotated

import tyro

from flexlab.cli.console import complain, new_table, output, print_json, print_json_text
from flexlab.cli.options import Law, Seed, Settings, chosen_scenarios, option
from flexlab.cli.warmup import loading
from flexlab.errors import FlexlabError, StudyError

if TYPE_CHECKING:
    from flexlab.scenario import Scenario


def command(
    preset: tyro.conf.Positional[Annotated[str, option("Preset to print as a scenario file.", "[PRESET]")]] = "",
    set_: Settings = (),
    law: Law = None,
    seed: Seed = None,
    as_json: Annotated[bool, option("List the presets as JSON, with all fields.", name="json")] = False,
    schema: Annotated[
        bool, option("Write presets/schema/scenario.json here: with it, editors check scenario files.")
    ] = False,
) -> int:
    """List the presets: name, title and what to watch. Or print one, with your changes, as a new scenario file.

    A scenario file NAME.json in a folder `presets` where you work is also a preset.
    """
    changed = bool(set_) or law is not None or seed is not None
    if schema:
        if as_json or preset or changed:
            raise StudyError("--schema writes the schema of all scenario files: give nothing else with it.")
        with loading():
            from flexlab.files import writable
            from flexlab.presets import OWN_FOLDER, write_schema

        with writable("The schema", "work in a folder that you may write to"):
            file = write_schema(OWN_FOLDER)
        output().out(f"{file} is written: editors find it through a scenario file's $schema.")
        return 0
    if preset:
        with loading():
            from flexlab.presets import scenario_text

        ((_, scenario),) = chosen_scenarios([preset], set_, law, seed)
        print_json_text(scenario_text(scenario))
        return 0
    if changed:
        raise StudyError("Say which preset to change, as in flexlab presets paper --set gravity=9.81.")
    with loading():
        from flexlab.presets import load_scenario_file, preset_files

    scenarios: dict[str, Scenario] = {}
    unreadable: list[str] = []
    for name, file in preset_files().items():
        try:
            scenarios[name] = load_scenario_file(file)
        except FlexlabError as error:
            unreadable.append(str(error))
    if as_json:
        print_json([{"name": name, **scenario.model_dump(mode="json")} for name, scenario in scenarios.items()])
    else:
        _print({name: (scenario.title, scenario.watch) for name, scenario in scenarios.items()})
    for sentence in unreadable:
        complain(sentence)
    return 2 if unreadable else 0


def _print(presets: dict[str, tuple[str, str]]) -> None:
    from rich.text import Text

    table = new_table(padding=(0, 2, 1, 0), show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column()
    for name, (title, watch) in presets.items():
        table.add_row(name, Text.assemble((title, "bold"), "\n", watch))
    output().print(table)
