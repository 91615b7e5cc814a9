"""`flexlab sweep PRESET`: vary fields over ranges: a table of metrics, heat maps."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from flexlab.cli.console import agreed, complain, note, tell, typed
from flexlab.cli.options import Cluster, Law, Preset, Seed, Settings, Several, Threads, chosen_scenarios, option
from flexlab.cli.warmup import loading, warm_up
from flexlab.errors import StudyError
from flexlab.text import counted

FAILED_SHOWN = 3
"""Most failed cells whose reasons are printed."""


def command(
    preset: tyro.conf.Positional[Preset],
    vary: Annotated[
        Several,
        option(
            "Field to vary: LOW:HIGH:COUNT, LOW:HIGH:log:COUNT, or values as in controller.kind=pd,none; may be repeated.",
            "PATH=RANGE",
        ),
    ] = (),
    duration: Annotated[float, option("Simulated time of a cell, s.", "S", default=None)] = 3.0,
    sample_period: Annotated[float, option("Time between samples, s.", "S", default=None)] = 0.001,
    set_: Settings = (),
    law: Law = None,
    seed: Seed = None,
    design: Annotated[
        Literal["grid", "latin-hypercube", "sobol"],
        option("All combinations, or a number of --samples drawn from the ranges.", default=None),
    ] = "grid",
    samples: Annotated[int | None, option("Number of cells that the design draws.", "N")] = None,
    design_seed: Annotated[int, option("Seed of the design.", "N", default=None)] = 0,
    accuracy: Annotated[float | None, option("Pose accuracy of the runs, m. (default: 1e-7)", "M")] = None,
    show: Annotated[str, option("Metrics to draw, as in rms_error.y,rms_internal_force.", "METRIC,…")] = "",
    pareto: Annotated[str, option("Two metrics to plot against each other.", "METRIC,METRIC", default=None)] = (
        "rms_error.y,rms_internal_force"
    ),
    to: Annotated[Path | None, option("Folder of table and figures. (default: sweeps/…)", "FOLDER")] = None,
    workers: Threads = None,
    cluster: Cluster = None,
    yes: Annotated[bool, option("Compute any number of cells without asking.")] = False,
) -> int:
    """Simulate PRESET with fields varied, gather the metrics of all cells in a table, and draw it.

    FOLDER gets cells.parquet and figures. To continue a sweep that was interrupted or killed, give the same command again.
    The table says why a cell failed.
    """
    with loading():
        ((name, scenario),) = chosen_scenarios([preset], set_, law, seed)
        from flexlab.analysis.metrics.metric import named
        from flexlab.analysis.sweep.axes import parse_axes
        from flexlab.analysis.sweep.figures import write_figures
        from flexlab.analysis.sweep.plan import DEFAULT_ACCURACY, MANY_CELLS, make_plan
        from flexlab.analysis.sweep.result import run_sweep, sweep_folder
        from flexlab.analysis.workers import chosen_workers, progress_bar

    wanted, axes = DEFAULT_ACCURACY if accuracy is None else accuracy, parse_axes(vary, scenario)
    plan = make_plan(scenario, axes, duration, sample_period, design, samples, design_seed, wanted)
    shown, pair = _names(show), _names(pareto)
    if len(pair) != 2:
        example = "rms_error.y,rms_internal_force"
        raise StudyError(f"--pareto {typed(pareto)} does not name two metrics: write two, as in {example}.")
    for metric in (*shown, *pair):
        named(metric)
    if plan.cell_count > MANY_CELLS and not yes:
        question = f"The sweep has {plan.cell_count} cells, which may take many hours. Compute them all?"
        if not agreed(question, "say --yes, or choose fewer values"):
            raise StudyError("Nothing was computed: choose fewer values.")
    folder = to or sweep_folder(name, plan)
    known = chosen_workers(workers, cluster)
    if cluster is None:
        warm_up(plan.scenario)
    with progress_bar(True) as told:
        sweep = run_sweep(plan, folder, known, told)
    tell(folder / "cells.parquet", *write_figures(plan, sweep.table, folder, shown, pair))
    failed = sweep.failed
    if not failed:
        note(f"{counted(len(sweep), 'cell')}.")
        return 0
    complain(f"{len(failed)} of {len(sweep)} cells failed; the table says why.")
    for cell, sentence in list(failed.items())[:FAILED_SHOWN]:
        complain(f"  cell {cell}: {sentence}")
    return 1 if len(failed) == len(sweep) else 0


def _names(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())
