"""Measurements in a fresh interpreter: times of a cold and a warm start, and memory of a run and of the live engine.

A run should take little more memory than its samples, and the live engine must not grow.
"""

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from flexlab.errors import StudyError

START = """
import json, time
start = time.perf_counter()
from flexlab.presets import load_preset
from flexlab.sim.world import World
scenario = load_preset("paper")
imported = time.perf_counter()
World(scenario).run(1)
ready = time.perf_counter()
print(json.dumps([imported - start, ready - imported, time.process_time()]))
"""
"""The program that starts the engine up to the first sample, for a fresh interpreter."""
EVERYTHING = """
import json, os, time
start = time.perf_counter()
from flexlab.machine import cores
from flexlab.sim.compile_all import compile_everything
imported = time.perf_counter()
compile_everything(cores())
print(json.dumps([imported - start, time.perf_counter() - imported, sum(os.times()[:4])]))
"""
"""The program that compiles what a cold start leaves for later, on all cores; the processor time is that of all processes."""
LONGEST_START = 1500
"""Longest start, s of wall time: nearly ten times the compilation of everything."""


@dataclass(frozen=True)
class Start:
    """Times of one start of the engine in a fresh interpreter."""

    importing: float
    """Wall time of the imports, s."""
    preparing: float
    """Wall time from there to the first sample, s: compiling or loading machine code, building the world."""
    cpu: float
    """Processor time of both, s."""


@dataclass(frozen=True)
class StartTimes:
    """Times of a cold start, with nothing compiled, and of a warm one, with machine code on disk."""

    cold: Start | None
    """None if it was not measured."""
    warm: Start
    rest: Start | None = None
    """Compilation after a cold start, on all cores: the other integrators, laws and sampled control."""


def start_times(cold: bool) -> StartTimes:
    """Measure a warm start, and a cold one if asked for (it compiles everything: minutes)."""
    warm = min((Start(*run_probe(START, dict(os.environ))) for _ in range(2)), key=lambda start: start.cpu)
    if not cold:
        return StartTimes(None, warm)
    with tempfile.TemporaryDirectory(prefix="flexlab-bench-") as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder}
        cold_start, rest = (Start(*run_probe(program, environment)) for program in (START, EVERYTHING))
        return StartTimes(cold_start, warm, rest)


def run_probe(program: str, environment: dict[str, str]) -> list[float]:
    """The JSON list that a Python program prints in a fresh interpreter. Raises `StudyError` if it fails."""
    try:
        command, nothing = [sys.executable, "-c", program], subprocess.DEVNULL
        printed = subprocess.check_output(
            command, env=environment, stdin=nothing, stderr=subprocess.PIPE, text=True, timeout=LONGEST_START
        )
        return json.loads(printed)
    except (subprocess.SubprocessError, OSError, ValueError) as error:
        detail = getattr(error, "stderr", None) or str(error)
        raise StudyError(f"A fresh interpreter for the measurement failed: {str(detail).strip()[-300:]}") from None


DURATION = 60.0
"""Simulated time of the run whose memory is measured, s: tens of megabytes of samples."""
WEIGHING = """
import json
from flexlab.benchmarks.fresh_process import weigh_live, weigh_run
print(json.dumps([*weigh_run(), weigh_live()]))
"""
"""The program that measures memory, in a fresh interpreter because a peak never falls again."""
LIVE_START, LIVE_END = 80, 160
"""Simulated times of the live engine between which its growth is measured, s; its history of a minute is full by then."""
LIVE_FRAME = 0.05
"""Simulated time per frame of the live engine, s."""
_STATUS = Path("/proc/self/status")
_FORGET_PEAK = Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Memory:
    """Memory of a run and of the live engine, bytes."""

    stored: int
    """Size of the samples of a run of `DURATION`."""
    peak_growth: int
    """Growth of the process's peak memory during the run, after a short one."""
    live_growth: int
    """Growth of the live engine's memory during 80 s of simulation."""

    @property
    def overhead(self) -> float:
        """Growth of the peak as a multiple of the samples' size; 1 if nothing else is kept."""
        return self.peak_growth / self.stored


def measure_memory() -> Memory | None:
    """Measure the memory of a run and of the live engine in a fresh interpreter; None on systems other than Linux."""
    if not _STATUS.exists():
        return None
    return Memory(*(int(value) for value in run_probe(WEIGHING, dict(os.environ))))


def weigh_run() -> tuple[int, int]:
    """Size of a run's samples, and growth of the process's peak memory during the run, bytes."""
    from flexlab.presets import load_preset
    from flexlab.sim.simulate import simulate

    scenario = load_preset("paper").replace({"simulation.step": 1e-3})
    simulate(scenario, 0.1)
    # Imports and machine code may have needed more memory for a moment: measure the peak from here on.
    _FORGET_PEAK.write_text("5", encoding="ascii")
    before = resident("VmHWM")
    run = simulate(scenario, DURATION)
    base = run.time
    while base.base is not None:
        base = base.base
    return base.nbytes, resident("VmHWM") - before


def weigh_live() -> int:
    """Growth of the live engine's memory, without a screen and with an accelerated clock, bytes."""
    from flexlab.presets import load_preset
    from flexlab.sim.runner import Runner

    now = [0.0]
    runner = Runner(load_preset("paper"), clock=lambda: now[0])
    weight = 0
    while now[0] < LIVE_END:
        now[0] += LIVE_FRAME
        runner.frame()
        if weight == 0 and now[0] >= LIVE_START:
            weight = resident("VmRSS")
    runner.stop()
    return resident("VmRSS") - weight


def resident(field: str) -> int:
    """This process's memory on Linux, bytes; `field`: VmRSS for the present memory, VmHWM for the peak."""
    for line in _STATUS.read_text(encoding="ascii").splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) * 1024
    raise OSError(f"{_STATUS} has no {field}")
