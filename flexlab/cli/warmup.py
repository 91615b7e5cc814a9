"""The first start on a machine compiles the engine: say so, show that something happens."""

from flexlab.cli.console import note, notes
from flexlab.scenario import Scenario


def warm_up(scenario: Scenario) -> None:
    """Make sure that the engine is compiled, telling the person when that takes long."""
    from flexlab.compiled import is_warm

    if is_warm():
        _compile(scenario)
        return
    note("First start on this machine: compiling the equations of motion, once. This takes about half a minute.")
    if not notes().is_terminal:
        _compile(scenario)
        note("Compiled.")
        return
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = SpinnerColumn(), TextColumn("compiling"), TimeElapsedColumn()
    with Progress(*columns, console=notes(), transient=True) as progress:
        progress.add_task("compiling", total=None)
        _compile(scenario)


def _compile(scenario: Scenario) -> None:
    """One sample period of simulation goes through every kernel."""
    from flexlab.sim.world import World

    World(scenario).run(1)
