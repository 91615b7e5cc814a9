"""`flexlab tune PRESET`: search ranges for the parameters that cost least."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from flexlab.cli.console import complain, output
from flexlab.cli.options import Cluster, Law, Preset, Seed, Settings, Threads, chosen_scenarios

if TYPE_CHECKING:
    from flexlab.analysis.tuning import Tuning
    from flexlab.scenario import Scenario


def command(
    preset: tyro.conf.Positional[Preset],
    change: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(
            metavar="PATH=LOW:HIGH[:log]",
            help="What may change, and within which bounds; repeat it.",
            help_behavior_hint="",
        ),
    ] = (),
    cost: Annotated[
        str, tyro.conf.arg(metavar="METRIC=WEIGHT,…", help="What is to be small, in SI units.")
    ] = "rms_error.x,rms_error.y",
    limit: Annotated[
        str, tyro.conf.arg(metavar="METRIC=VALUE,…", help="What must not be exceeded.", help_behavior_hint="")
    ] = "",
    robust: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(
            metavar="PATH=VALUE,…",
            help="The worst of these scenarios counts, as in payload.bending_stiffness=50,200.",
            help_behavior_hint="",
        ),
    ] = (),
    duration: Annotated[float, tyro.conf.arg(metavar="S", help="Simulated time of a run, s.")] = 3.0,
    candidates: Annotated[int, tyro.conf.arg(metavar="N", help="Parameters to try, about.")] = 200,
    search_seed: Annotated[int, tyro.conf.arg(metavar="N", help="Of the search.")] = 0,
    workers: Threads = None,
    cluster: Cluster = None,
    set_: Settings = (),
    law: Law = None,
    seed: Seed = None,
    save: Annotated[
        Path | None,
        tyro.conf.arg(metavar="FILE.json", help="Write the tuned scenario: a preset.", help_behavior_hint=""),
    ] = None,
    figure: Annotated[
        Path | None,
        tyro.conf.arg(metavar="FILE.svg", help="Draw the trade-off among what was tried.", help_behavior_hint=""),
    ] = None,
) -> int:
    """Search the ranges for the parameters that cost least, and say what they gain.

    Metrics are named as in rms_error.y, rms_internal_force, settling_time, peak_torque; the names of earlier versions, as in
    rms-y, are in the units of tables. Exits with 1 if nothing keeps within the limits.
    """
    ((_, scenario),) = chosen_scenarios([preset], set_, law, seed)
    from flexlab.analysis.sweep.axes import parse_axes
    from flexlab.analysis.tuning import parse_cost, tune, write_trade_off
    from flexlab.analysis.workers import chosen_workers, progress_bar
    from flexlab.cli.warmup import warm_up
    from flexlab.presets import save_scenario

    axes = parse_axes(change, scenario)
    others = parse_axes(robust, scenario) if robust else ()
    wanted = parse_cost(cost, limit)
    known = chosen_workers(workers, cluster)
    warm_up(scenario)
    with progress_bar(True, "candidates") as told:
        found = tune(scenario, axes, wanted, others, duration, candidates, search_seed, told, known)
    _print(found)
    best = found.best
    if save is not None:
        save_scenario(found.tuned, save)
        output().print(str(save), soft_wrap=True)
    if figure is not None:
        write_trade_off(found, figure)
        output().print(str(figure), soft_wrap=True)
    if best.metrics is None or not wanted.holds(best.metrics):
        complain("Nothing that was tried keeps within the limits: widen the bounds or the limits.")
        return 1
    return 0


def _print(found: "Tuning") -> None:
    from rich.table import Table
    from rich.text import Text

    from flexlab.analysis.tuning import numbers_of

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column("")
    for head in ("before", "tuned"):
        table.add_column(head, justify="right")
    for path, value in found.best.changes.items():
        table.add_row(Text(path), Text(str(_there(found.scenario, path))), f"{value:.6g}")
    before, after = (numbers_of(item.metrics) if item.metrics else {} for item in (found.before, found.best))
    for name in found.cost.names:
        table.add_row(Text(name), *(f"{values[name]:.5g}" if values else "fails" for values in (before, after)))
    table.add_row("cost", f"{found.before.cost:.5g}", f"{found.best.cost:.5g}")
    output().print(table)
    output().print(f"{len(found.candidates)} candidates were tried.")


def _there(scenario: "Scenario", path: str) -> object:
    return scenario.get(path) if scenario.has(path) else "–"
