"""`flexlab run`: a simulation without a screen."""

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from flexlab.cli.console import complain, notes, output
from flexlab.cli.options import LOGS, Logs, Preset
from flexlab.errors import StudyError

if TYPE_CHECKING:
    from flexlab.sim.samples import Samples
    from flexlab.sim.world import World

BLOCK = 1000
"""Samples between two writes: a megabyte at most, so that long runs need no more memory than short ones."""

LONGEST_DURATION = 1e6
"""s."""


def command(
    preset: tyro.conf.Positional[Preset],
    duration: Annotated[float, tyro.conf.arg(metavar="S", help="Simulated time, s.")] = 3.0,
    sample_period: Annotated[float, tyro.conf.arg(metavar="S", help="Time between samples, s.")] = 0.001,
    logs: Logs = LOGS,
) -> int:
    """Simulate PRESET without a screen, as fast as the machine can, record it and print a summary."""
    from flexlab.presets import find_scenario

    name, scenario = find_scenario(preset)
    from flexlab.sim.snapshot import LONGEST_PERIOD, SHORTEST_PERIOD

    # The period first: it is the shortest duration.
    _check("sample-period", sample_period, SHORTEST_PERIOD, LONGEST_PERIOD)
    _check("duration", duration, sample_period, LONGEST_DURATION)

    from flexlab.cli.warmup import warm_up
    from flexlab.recording.store.run_files import check_folder
    from flexlab.sim.world import World

    check_folder(logs)
    warm_up(scenario)
    return _simulate(World(scenario, sample_period), name, duration, logs)


def _check(option: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise StudyError(f"--{option} {value:g} is not usable: give a number of seconds from {low:g} to {high:g}.")


def _simulate(world: "World", name: str, duration: float, logs: Path) -> int:
    """Run the world, record it, tell how it went; returns the exit code."""
    from flexlab.analysis.run_summary import run_notes
    from flexlab.cli.run_report import Summary
    from flexlab.recording.headless import HeadlessRecording
    from flexlab.recording.run_info import RunInfo
    from flexlab.sim.simulate import finished

    summary = Summary()
    began = time.perf_counter()
    with HeadlessRecording(logs, RunInfo(name, world.scenario, world.tick_period), run_notes) as recording:
        for samples in _blocks(world, math.floor(duration / world.tick_period * (1 + 1e-12) + 1e-9)):
            summary.add(samples)
            recording.write(samples)
        status = world.status
        if not status.failed:
            status = finished(world)
        recording.end(status)
    took = time.perf_counter() - began
    output().print(f"{name}: {world.scenario.title}", style="bold", markup=False)
    output().print(summary.table(status))
    output().print(summary.settling_text())
    output().print(
        f"{summary.count} samples in {took:.2f} s with {world.integrator}, steps of {1e6 * world.step:.4g} µs."
    )
    output().print(f"Recorded in {recording.path}", markup=False, soft_wrap=True)
    if world.accuracy_warning:
        complain(world.accuracy_warning)
    if status.failed:
        complain(status.text)
        return 1
    return 0


def _blocks(world: "World", ticks: int) -> Iterator["Samples"]:
    """The run from the present instant on, in blocks, under a progress bar."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn("simulating"), BarColumn(), TextColumn("{task.percentage:.0f} %"), TimeRemainingColumn()
    with Progress(*columns, console=notes(), transient=True, disable=not notes().is_terminal) as progress:
        task = progress.add_task("simulating", total=ticks)
        samples = world.run(min(BLOCK, ticks))
        while True:
            if len(samples):
                yield samples
            progress.update(task, completed=world.tick)
            if world.status.failed or world.tick >= ticks:
                return
            samples = world.advance(min(BLOCK, ticks - world.tick))
