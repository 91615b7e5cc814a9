"""A simulation without a screen: recorded, told on the terminal, or kept as numbers for a program."""

import math
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexlab.analysis.explanations import LONGEST_LOOK
from flexlab.analysis.metrics import MetricCollection, RunMetrics
from flexlab.analysis.result_hash import ResultHash
from flexlab.analysis.run_summary import run_notes
from flexlab.cli.console import complain, notes, output
from flexlab.cli.no_pandas import leave_pandas_out
from flexlab.cli.run_report import Summary, explained
from flexlab.recording.headless import HeadlessRecording
from flexlab.recording.run_info import RunInfo
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples, Status, join_blocks
from flexlab.sim.simulate import finished
from flexlab.sim.world import World

BLOCK = 1000
"""Samples between two writes: a megabyte at most, so that long runs need no more memory than short ones."""
KEPT = round(LONGEST_LOOK / 0.001 / BLOCK)
"""Newest blocks that are kept for explanations: all that they look at, at the usual sample period."""


@dataclass(frozen=True)
class EndedRun:
    """What is known of a run that has been recorded."""

    name: str
    path: Path
    world: World
    status: Status
    samples: int
    seconds: float
    """Of the clock."""
    result_hash: str
    metrics: RunMetrics

    def as_json(self) -> dict[str, Any]:
        """Plain data, all digits, SI units; null where a number has no value."""
        return {
            "name": self.name,
            "file": str(self.path),
            "status": str(self.status),
            "text": self.status.text,
            "samples": self.samples,
            "sample_period": self.world.tick_period,
            "time": self.status.time,
            "result_hash": self.result_hash,
            "metrics": self.metrics.as_data(),
            "accuracy_warning": self.world.accuracy_warning,
            "axial_warning": self.world.axial_warning.text,
            "pace_warning": self.world.pace_warning,
            "integrator": self.world.integrator,
            "step": self.world.step,
            "seconds": self.seconds,
            "scenario": self.world.scenario.model_dump(mode="json"),
        }


def run_and_record(
    name: str, scenario: Scenario, duration: float, sample_period: float, logs: Path, quiet: bool = False
) -> EndedRun:
    """Simulate and record a scenario; unless `quiet`, print how it went. Complaints go to standard error in any case."""
    world, summary, hashed, metrics = World(scenario, sample_period), Summary(), ResultHash(), MetricCollection()
    if world.pace_warning:
        complain(world.pace_warning)
    leave_pandas_out()
    kept: deque[Samples] = deque(maxlen=KEPT)
    began = time.perf_counter()
    with HeadlessRecording(logs, RunInfo(name, world.scenario, world.tick_period), run_notes) as recording:
        for samples in _blocks(world, math.floor(duration / world.tick_period * (1 + 1e-12) + 1e-9)):
            summary.add(samples)
            hashed.update(samples)
            metrics.update(samples)
            recording.write(samples)
            kept.append(samples)
        status = world.status if world.status.failed else finished(world)
        recording.end(status)
    took = time.perf_counter() - began
    ended = EndedRun(
        name, recording.path, world, status, summary.count, took, hashed.text(), metrics.compute(not status.failed)
    )
    if not quiet:
        _tell(ended, summary)
        if kept:
            for line in explained(join_blocks(list(kept)), world.scenario):
                output().print(line)
    if world.accuracy_warning:
        complain(world.accuracy_warning)
    if world.axial_warning.text:
        complain(world.axial_warning.text)
    if status.failed:
        complain(status.text)
    return ended


def _tell(run: EndedRun, summary: Summary) -> None:
    output().print(f"{run.name}: {run.world.scenario.title}", style="bold")
    output().print(summary.table(run.status))
    output().print(summary.settling_text())
    output().print(
        f"{run.samples} samples in {run.seconds:.2f} s with {run.world.integrator}, "
        f"steps of {1e6 * run.world.step:.4g} µs. Result {run.result_hash}."
    )
    output().print(f"Recorded in {run.path}", soft_wrap=True)


@contextmanager
def _progress(ticks: int) -> Generator[Callable[[int], None], None, None]:
    """A progress bar on a terminal, and what moves it on to a tick."""
    if not notes().is_terminal:
        yield lambda _: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn("simulating"), BarColumn(), TextColumn("{task.percentage:.0f} %"), TimeRemainingColumn()
    with Progress(*columns, console=notes(), transient=True) as progress:
        task = progress.add_task("simulating", total=ticks)
        yield lambda tick: progress.update(task, completed=tick)


def _blocks(world: World, ticks: int) -> Iterator[Samples]:
    """The run from the present instant on, in blocks, under a progress bar where somebody watches."""
    with _progress(ticks) as advance_to:
        samples = world.run(min(BLOCK, ticks))
        while True:
            if len(samples):
                yield samples
            advance_to(world.tick)
            if world.status.failed or world.tick >= ticks:
                return
            samples = world.advance(min(BLOCK, ticks - world.tick))
