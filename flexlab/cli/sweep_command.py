"""`flexlab sweep PRESET`: vary fields over ranges: a table of metrics, heat maps."""

import shlex
from pathlib import Path
from typing import Annotated, Literal

import tyro

from flexlab.cli.console import complain, note, output
from flexlab.cli.options import Cluster, Law, Preset, Seed, Settings, Threads, chosen_scenarios

FAILED_SHOWN = 3
"""Of cells that failed, how many are said."""


def command(
    preset: tyro.conf.Positional[Preset],
    vary: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(
            metavar="PATH=RANGE",
            help="What to vary: LOW:HIGH:COUNT, LOW:HIGH:log:COUNT, or values as in controller.kind=pd,none; repeat it.",
            help_behavior_hint="",
        ),
    ] = (),
    duration: Annotated[float, tyro.conf.arg(metavar="S", help="Simulated time of a cell, s.")] = 3.0,
    sample_period: Annotated[float, tyro.conf.arg(metavar="S", help="Time between samples, s.")] = 0.001,
    set_: Settings = (),
    law: Law = None,
    seed: Seed = None,
    design: Annotated[
        Literal["grid", "latin-hypercube", "sobol"],
        tyro.conf.arg(help="All combinations, or --samples drawn from the ranges."),
    ] = "grid",
    samples: Annotated[
        int | None, tyro.conf.arg(metavar="N", help="Cells that a design draws.", help_behavior_hint="")
    ] = None,
    design_seed: Annotated[int, tyro.conf.arg(metavar="N", help="Of what a design draws.")] = 0,
    accuracy: Annotated[
        float | None,
        tyro.conf.arg(metavar="M", help="Pose accuracy of the runs, m. (default: 1e-7)", help_behavior_hint=""),
    ] = None,
    show: Annotated[
        str,
        tyro.conf.arg(
            metavar="METRIC,…", help="Metrics to draw, as in rms_error.y,rms_internal_force.", help_behavior_hint=""
        ),
    ] = "",
    pareto: Annotated[str, tyro.conf.arg(metavar="METRIC,METRIC", help="Two metrics to draw over each other.")] = (
        "rms_error.y,rms_internal_force"
    ),
    to: Annotated[
        Path | None,
        tyro.conf.arg(metavar="FOLDER", help="Where it all goes. (default: sweeps/…)", help_behavior_hint=""),
    ] = None,
    workers: Threads = None,
    cluster: Cluster = None,
    yes: Annotated[bool, tyro.conf.arg(help="Do not ask, however many cells.", help_behavior_hint="")] = False,
) -> int:
    """Simulate PRESET with fields varied, gather the metrics of all cells in a table, and draw it.

    FOLDER gets cells.parquet and figures. A sweep that was interrupted or killed goes on where it was when the same command
    is given again. A cell that fails says why in the table.
    """
    ((name, scenario),) = chosen_scenarios([preset], set_, law, seed)
    from flexlab.analysis.sweep.axes import parse_axes
    from flexlab.analysis.sweep.figures import metric_column, write_figures
    from flexlab.analysis.sweep.plan import DEFAULT_ACCURACY, make_plan
    from flexlab.analysis.sweep.result import Sweep, run_sweep, sweep_folder
    from flexlab.analysis.workers import chosen_workers, progress_bar
    from flexlab.cli.warmup import warm_up

    wanted = DEFAULT_ACCURACY if accuracy is None else accuracy
    plan = make_plan(
        scenario, parse_axes(vary, scenario), duration, sample_period, design, samples, design_seed, wanted
    )
    shown, pair = _names(show), _pair(pareto)
    for metric in (*shown, *pair):
        metric_column(metric)
    _ask(plan.cell_count, yes)
    folder = to or sweep_folder(name, plan)
    known = chosen_workers(workers, cluster)
    if cluster is None:
        warm_up(plan.scenario)
    with progress_bar(True) as told:
        run_sweep(plan, folder, known, told)
    sweep = Sweep(plan, folder)
    paths = write_figures(sweep, shown, pair)
    for path in (folder / "cells.parquet", *paths):
        output().print(str(path), soft_wrap=True)
    _tell_failed(sweep.failed, len(sweep))
    return 1 if len(sweep.failed) == len(sweep) else 0


def _names(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _pair(text: str) -> tuple[str, ...]:
    from flexlab.errors import StudyError

    names = _names(text)
    if len(names) != 2:
        raise StudyError(
            f"--pareto {shlex.quote(text)} names no two metrics: write two, as in rms_error.y,rms_internal_force."
        )
    return names


def _ask(cells: int, yes: bool) -> None:
    from flexlab.analysis.sweep.plan import MANY_CELLS
    from flexlab.cli.console import agreed
    from flexlab.errors import StudyError

    if cells > MANY_CELLS and not yes:
        question = f"The sweep has {cells} cells, which may take many hours. Compute them all?"
        if not agreed(question, "say --yes, or choose fewer values"):
            raise StudyError("Nothing was computed: choose fewer values.")


def _tell_failed(failed: dict[int, str], cells: int) -> None:
    if not failed:
        note(f"{cells} cells.")
        return
    complain(f"{len(failed)} of {cells} cells failed; the table says why.")
    for cell, sentence in list(failed.items())[:FAILED_SHOWN]:
        complain(f"  cell {cell}: {sentence}")
