"""`flexlab presets`: what there is to try."""

from flexlab.cli.console import complain, output
from flexlab.errors import FlexlabError


def command() -> int:
    """List the presets: name, title and what to watch.

    A scenario file NAME.json in a folder `presets` where you work is a preset too.
    """
    from rich.table import Table
    from rich.text import Text

    from flexlab.presets import load_scenario_file, preset_files

    table = Table(box=None, pad_edge=False, padding=(0, 2, 1, 0), show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column()
    unreadable = []
    for name, file in preset_files().items():
        try:
            scenario = load_scenario_file(file)
        except FlexlabError as error:
            unreadable.append(str(error))
            continue
        table.add_row(Text(name), Text.assemble((scenario.title, "bold"), "\n", scenario.watch))
    output().print(table)
    for sentence in unreadable:
        complain(sentence)
    return 2 if unreadable else 0
