"""`flexlab tune PRESET`: search ranges for the parameters of least cost."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from flexlab.cli.console import complain, new_table, output, tell
from flexlab.cli.options import (
    Cluster,
    Law,
    Preset,
    Seed,
    Settings,
    Several,
    Threads,
    check_scenario_file,
    chosen_scenarios,
    option,
)
from flexlab.cli.warmup import loading, warm_up

if TYPE_CHECKING:
    from flexlab.analysis.tuning import Tuning


def command(
    preset: tyro.conf.Positional[Preset],
    change: Annotated[
        Several, option("Field that may change, and its bounds; may be repeated.", "PATH=LOW:HIGH[:log]")
    ] = (),
    cost: Annotated[
        str, option("Metrics to minimise, with weights, in SI units.", "METRIC=WEIGHT,…", default=None)
    ] = "rms_error.x,rms_error.y",
    limit: Annotated[str, option("Largest allowed values of metrics.", "METRIC=VALUE,…")] = "",
    robust: Annotated[
        Several, option("Scenarios of which the worst counts, as in payload.bending_stiffness=50,200.", "PATH=VALUE,…")
    ] = (),
    duration: Annotated[float, option("Simulated time of a run, s.", "S", default=None)] = 3.0,
    candidates: Annotated[int, option("Number of candidates, with the scenario as it is.", "N", default=None)] = 200,
    search_seed: Annotated[int, option("Seed of the search.", "N", default=None)] = 0,
    workers: Threads = None,
    cluster: Cluster = None,
    set_: Settings = (),
    law: Law = None,
    seed: Seed = None,
    save: Annotated[Path | None, option("Write the tuned scenario as a preset.", "FILE.json")] = None,
    figure: Annotated[Path | None, option("Draw the trade-off between the candidates.", "FILE.svg")] = None,
) -> int:
    """Search the ranges for the parameters of least cost, and print what they gain.

    Metrics have names such as rms_error.y, rms_internal_force, settling_time, peak_torque; names of earlier versions, such as
    rms-y, are in the units of tables. Exits with 1 if no candidate keeps within the limits, or every run fails.
    """
    with loading():
        ((_, scenario),) = chosen_scenarios([preset], set_, law, seed)
        from flexlab.analysis.figures import figure_kind, save_figure
        from flexlab.analysis.sweep.axes import parse_axes
        from flexlab.analysis.tuning import parse_cost, tune
        from flexlab.analysis.workers import chosen_workers, progress_bar
        from flexlab.files import check_writing
        from flexlab.presets import save_scenario

    axes = parse_axes(change, scenario)
    others = parse_axes(robust, scenario) if robust else ()
    wanted = parse_cost(cost, limit)
    if save is not None:  # Before hours of work.
        check_scenario_file(save)
    if figure is not None:
        check_writing(figure, f".{figure_kind(figure)}")
    known = chosen_workers(workers, cluster)
    warm_up(scenario)
    with progress_bar(True, "candidates") as told:
        found = tune(scenario, axes, wanted, others, duration, candidates, search_seed, told, known)
    _print(found)
    if save is not None:
        save_scenario(found.tuned, save)
        tell(save)
    if figure is not None:
        tell(save_figure(found.plot(), figure))
    if found.problem:
        complain(found.problem)
        return 1
    return 0


def _print(found: "Tuning") -> None:
    from flexlab.analysis.metrics.metric import named

    table = new_table()
    table.add_column("")
    for head in ("before", "tuned"):
        table.add_column(head, justify="right")
    for path, value in found.best.changes.items():
        before = found.scenario.get(path) if found.scenario.has(path) else "–"
        table.add_row(path, str(before), f"{value:.6g}")
    both = found.before, found.best
    for name in found.cost.names:
        limit = f", at most {found.cost.limits[name]:g}" if name in found.cost.limits else ""
        missing = named(name).column.missing
        values = ("fails" if each.metrics is None else _number(each.metrics[name], missing) for each in both)
        table.add_row(f"{name}{limit}", *values)
    table.add_row("cost", *("fails" if each.metrics is None else _number(each.cost, "–") for each in both))
    output().print(table)
    output().print(f"Candidates tried: {len(found.candidates)}.")


def _number(value: float, missing: str) -> str:
    return f"{value:.5g}" if value == value else missing
