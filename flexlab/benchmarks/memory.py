"""Memory: a run may hold its samples and little else, and the live engine must not grow."""

import os
from dataclasses import dataclass
from pathlib import Path

from flexlab.benchmarks.startup import run_probe

DURATION = 60.0
"""Simulated time of the run that is weighed, s: tens of megabytes of samples."""

PROBE = """
import json
from flexlab.benchmarks.memory import weigh_live, weigh_run
print(json.dumps([*weigh_run(), weigh_live()]))
"""
"""A fresh interpreter, as a peak once reached never falls again."""

LIVE_START, LIVE_END = 40, 160
"""Simulated seconds of the live engine between which it is weighed: its 30 s of history are full before."""

LIVE_FRAME = 0.05
"""Simulated seconds per frame of the live engine, s."""

_STATUS = Path("/proc/self/status")
_FORGET_PEAK = Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Memory:
    """Bytes."""

    stored: int
    """Samples of a run of `DURATION`."""
    peak_growth: int
    """How much more memory the process held at most, after a short run before it."""
    live_growth: int
    """How much more memory the live engine held after two minutes more of simulation."""

    @property
    def overhead(self) -> float:
        """Peak growth over stored samples: 1 if nothing else is kept."""
        return self.peak_growth / self.stored


def measure_memory() -> Memory | None:
    """Weigh a run and the live engine in a fresh interpreter; None where the system does not tell (only Linux does)."""
    if not _STATUS.exists():
        return None
    return Memory(*(int(value) for value in run_probe(PROBE, dict(os.environ))))


def weigh_run() -> tuple[int, int]:
    """Bytes of a run's samples, and growth of the peak through it."""
    from flexlab.presets import load_preset
    from flexlab.sim.simulate import simulate

    scenario = load_preset("paper").replace({"simulation.step": 1e-3})
    simulate(scenario, 0.1)
    # Importing and loading machine code may have needed more for a moment: count the peak from here on.
    _FORGET_PEAK.write_text("5", encoding="ascii")
    before = resident("VmHWM")
    run = simulate(scenario, DURATION)
    base = run.time
    while base.base is not None:
        base = base.base
    return base.nbytes, resident("VmHWM") - before


def weigh_live() -> int:
    """Growth of the live engine, without a screen and with a clock that runs as fast as it can, bytes."""
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
    """Bytes of this process's memory by Linux: VmRSS now, VmHWM at most so far."""
    for line in _STATUS.read_text(encoding="ascii").splitlines():
        if line.startswith(field + ":"):
            return int(line.split()[1]) * 1024
    raise OSError(f"{_STATUS} has no {field}")
