"""A simulation without a screen: its recording, its summary on the terminal, and its numbers for programs."""

import math
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexlab.analysis.explanations.explanation import LONGEST_LOOK, explain_run
from flexlab.analysis.metrics import Column, RunMetrics
from flexlab.analysis.metrics.metric import Peak, of_signal
from flexlab.analysis.metrics.run_metrics import value_text
from flexlab.analysis.result import ResultHash
from flexlab.analysis.run_summary import MetricNotes
from flexlab.analysis.workers import progress_bar
from flexlab.cli.console import complain, new_table, output, tell
from flexlab.recording.course import coarse_note
from flexlab.recording.headless import HeadlessRecording
from flexlab.recording.run_info import RunInfo
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples, Status, join_blocks
from flexlab.sim.simulate import end_status
from flexlab.sim.snapshot import TICK
from flexlab.sim.world import World
from flexlab.text import counted, number_text

if TYPE_CHECKING:
    from rich.table import Table


MOST_EXPLAINED = 3
START_SPAN = 1.0
"""Length of the start, s, in which the paper's controller reaches the path and the beam calms down."""


def explained(samples: Samples, scenario: Scenario) -> list[str]:
    """The explanations of a run's last samples, one line each; none if the scenario has no modes."""
    found = explain_run(samples, scenario, start=0.0)[:MOST_EXPLAINED]
    return [f"{each.plot}: {each.sentence} ({each.equation})" for each in found]


@of_signal(
    Peak,
    0,
    Column("", "tracking error x", "", "mm", 1e3),
    Column("", "tracking error y", "", "mm", 1e3),
    Column("", "tracking error θ", "", "mrad", 1e3),
    Column("", "mid-span deflection", "", "mm", 1e3),
    Column("", "of it vibration", "", "mm", 1e3),
    Column("", "internal force", "", "N"),
    Column("", "joint torque", "", "N·m"),
)
def largest(samples: Samples) -> np.ndarray:
    """The largest magnitudes of a summary."""
    force = np.linalg.norm(samples.internal_force[..., :2], axis=-1).max(axis=1)
    torque = np.abs(samples.joint_torque).max(axis=(1, 2))
    return np.column_stack([samples.tracking_error, samples.midspan_deflection, samples.vibration, force, torque])


class Summary:
    """The largest magnitudes over the start and over the rest of a run."""

    def __init__(self) -> None:
        self.count = 0
        self.time = 0.0
        self._start, self._later = largest(), largest()

    def add(self, samples: Samples) -> None:
        """Take in the next block."""
        self.count += len(samples)
        self.time = float(samples.time[-1])
        early = int(samples.time.searchsorted(START_SPAN, side="right"))
        for part, first, last in ((self._start, 0, early), (self._later, early, len(samples))):
            if first < last:
                part.update(samples.slice(first, last))

    def table(self) -> "Table":
        """The magnitudes as a table for the terminal."""
        table = new_table(padding=(0, 3, 0, 0))
        table.add_column("largest")
        table.add_column(f"0 to {min(START_SPAN, self.time):g} s", justify="right")
        table.add_column(f"{START_SPAN:g} to {self.time:g} s" if self.time > START_SPAN else "later", justify="right")
        for column, *peaks in zip(largest.columns, self._start.compute(), self._later.compute(), strict=True):
            texts = (value_text(column, column.scale * peak) for peak in peaks)
            table.add_row(f"{column.title}, {column.unit}", *texts)
        return table


BLOCK = 1000
"""Samples per write, a megabyte at most, so that long runs need no more memory than short ones."""
KEPT = round(LONGEST_LOOK / 0.001 / BLOCK)
"""Number of last blocks that are kept for explanations, enough at the usual sample period."""


@dataclass(frozen=True)
class EndedRun:
    """The results of a recorded run."""

    name: str
    path: Path
    world: World
    status: Status
    samples: int
    seconds: float
    """Wall time of the simulation, s."""
    result_hash: str
    metrics: RunMetrics

    @property
    def sample_warning(self) -> str:
        """A sentence if the samples are too far apart for the vibration; empty otherwise."""
        period = self.world.tick_period
        return coarse_note(self.world.scenario, period, (self.samples - 1) * period)

    def as_json(self) -> dict[str, Any]:
        """The results as plain data with all digits, SI units; null for a missing value."""
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
            "model_warning": self.world.model_warning.text,
            "pace_warning": pace_warning(self.world),
            "sample_warning": self.sample_warning,
            "integrator": self.world.integrator,
            "step": self.world.step,
            "seconds": self.seconds,
            "scenario": self.world.scenario.model_dump(mode="json"),
        }


def pace_warning(world: World) -> str:
    """As `World.pace_warning`, but it names the sample period where samples of the usual one would not be slow."""
    text = world.pace_warning
    if not text or world.tick_period >= TICK or World(world.scenario).pace_warning:
        return text
    period = number_text(1e6 * world.tick_period, 3)
    cure = f"To keep up, choose a longer sample period, such as {TICK:g} s (--sample-period)."
    return f"{text.partition(', as ')[0]}, as there is a sample every {period} µs. {cure}"


def run_and_record(
    name: str, scenario: Scenario, duration: float, sample_period: float, logs: Path, quiet: bool = False
) -> EndedRun:
    """Simulate and record a scenario; print a summary unless `quiet`. Warnings always go to standard error."""
    world, summary, hashed = World(scenario, sample_period), Summary(), ResultHash()
    if slow := pace_warning(world):
        complain(slow)
    kept: deque[Samples] = deque(maxlen=KEPT)
    began, notes = time.perf_counter(), MetricNotes(name, world.scenario)
    with HeadlessRecording(logs, RunInfo(name, world.scenario, world.tick_period), notes) as recording:
        for samples in _blocks(world, math.floor(duration / world.tick_period * (1 + 1e-12) + 1e-9)):
            summary.add(samples)
            hashed.update(samples)
            recording.write(samples)
            kept.append(samples)
        status = end_status(world)
        recording.end(status)
    took = time.perf_counter() - began
    ended = EndedRun(name, recording.path, world, status, summary.count, took, hashed.text(), notes.metrics(status))
    if not quiet:
        _tell(ended, summary)
        if kept:
            for line in explained(join_blocks(list(kept)), world.scenario):
                output().print(line)
    last = status.text if status.failed else world.model_warning.text
    for warning in filter(None, (world.accuracy_warning, ended.sample_warning, last)):
        complain(warning)
    return ended


def _tell(run: EndedRun, summary: Summary) -> None:
    output().print(f"{run.name}: {run.world.scenario.title}", style="bold")
    output().print(summary.table())
    if not run.status.failed:
        [settled] = [row for row in run.metrics.rows if row.column.field == "settled"]
        is_settled = settled.value == settled.value
        output().print(f"{settled.title} {settled.text} s." if is_settled else f"Vibration: {settled.text}.")
    output().print(
        f"{counted(run.samples, 'sample')} in {run.seconds:.2f} s with {run.world.integrator}, "
        f"steps of {1e6 * run.world.step:.4g} µs. Result {run.result_hash}."
    )
    tell(f"Recorded in {run.path}")


def _blocks(world: World, ticks: int) -> Iterator[Samples]:
    """Simulate `ticks` sample periods in blocks, with a progress bar on a terminal."""
    with progress_bar(True, "simulating", "{task.percentage:.0f} %") as told:
        samples = world.run(min(BLOCK, ticks))
        while True:
            if len(samples):
                yield samples
            told(world.tick, ticks)
            if world.status.failed or world.tick >= ticks:
                return
            samples = world.advance(min(BLOCK, ticks - world.tick))
