"""Timing on a shared machine: processor time instead of wall time, and the shortest of several runs.

A disturbance only makes a run longer, so the shortest time is the best estimate of the cost.
"""

import os
import platform
import time
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from flexlab.machine import cores
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

SAMPLE_PERIOD = 1e-3
"""Sample period of lab and recordings, s; a sample costs about a quarter of a step."""
LEAST_TIME = 0.05
"""Smallest total processor time of the runs of one setting, s."""


@dataclass(frozen=True)
class Trial:
    """One scenario, simulated for its motion or several times for its cost."""

    samples: Samples
    """The samples, from the first sample period on."""
    completed: bool
    """False if the run stopped before its end."""
    cpu: float
    """Processor time, s."""
    step: float
    """Integration step, s."""
    duration: float
    """Simulated time, s."""

    @property
    def ms_per_second(self) -> float:
        """Processor time per simulated second, ms."""
        return 1e3 * self.cpu / self.duration

    @property
    def us_per_step(self) -> float:
        """Processor time per integration step, µs, samples included."""
        return 1e6 * self.cpu * self.step / self.duration

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second of processor time."""
        return self.duration / self.cpu


def try_out(
    scenario: Scenario, duration: float, repeats: int = 3, sample_period: float = SAMPLE_PERIOD, least_time: float = 0.0
) -> Trial:
    """Simulate `scenario` for `duration` s in new worlds, and take the shortest time, without that of building the worlds.

    The run is repeated at least `repeats` times, and until all runs add up to `least_time` s of processor time. Raises
    `ScenarioError` for an invalid scenario.
    """
    ticks = round(duration / sample_period)
    times: list[float] = []
    while len(times) < repeats or sum(times) < least_time:
        world = World(scenario, sample_period)
        start = time.thread_time()
        samples = world.advance(ticks)
        times.append(time.thread_time() - start)
        if len(samples) < ticks:
            break
    return Trial(samples, len(samples) == ticks, min(times), world.step, ticks * sample_period)


def largest_difference(signal: np.ndarray, reference: np.ndarray) -> float:
    """Largest difference of two signals (N, …) at their common instants."""
    count = min(len(signal), len(reference))
    return float(np.max(np.abs(signal[:count] - reference[:count]), initial=0.0))


LIBRARIES = ("flexlab", "numpy", "numba", "scipy")
"""Libraries whose versions affect speed."""


@dataclass(frozen=True)
class Machine:
    """Processor, load and versions."""

    processor: str
    cores: int
    """Number of cores that this process may use."""
    load: float | None
    """Load average of the last minute; None if the system does not have it."""
    system: str
    python: str
    versions: dict[str, str]

    @property
    def text(self) -> str:
        """The machine in one line."""
        busy = "" if self.load is None else f", load {self.load:.1f}"
        libraries = ", ".join(f"{name} {number}" for name, number in self.versions.items())
        return f"{self.processor}, {self.cores} cores{busy}; {self.system}, Python {self.python}, {libraries}"


def this_machine() -> Machine:
    """Describe this machine."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    versions = {name: number for name in LIBRARIES if (number := version_of(name))}
    return Machine(_processor(), cores(), load, platform.system(), platform.python_version(), versions)


def version_of(library: str) -> str | None:
    """The version of a library; None if it is not installed."""
    try:
        return version(library)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8", errors="replace").splitlines() if info.exists() else []
    named = (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())
