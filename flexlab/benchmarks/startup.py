"""How long the first simulation on a machine takes, where everything is compiled, and every later one."""

import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from flexlab.errors import StudyError

PROBE = """
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
"""What a start does before it can show anything; run in a fresh interpreter."""

EVERYTHING = """
import json, time
start = time.perf_counter()
from flexlab.sim.compile_all import compile_everything
imported = time.perf_counter()
compile_everything()
print(json.dumps([imported - start, time.perf_counter() - imported, time.process_time()]))
"""
"""The same for what a cold start leaves to be compiled meanwhile."""

LONGEST_START = 300
"""s of wall time after which a start is given up: ten times what a busy machine needs."""


@dataclass(frozen=True)
class Start:
    """Times of one start of the engine in a fresh interpreter."""

    importing: float
    """Wall time of the imports, s."""
    preparing: float
    """Wall time to the first sample after that, s: compiling or loading machine code, building the world."""
    cpu: float
    """Processor time of both, s."""


@dataclass(frozen=True)
class StartTimes:
    """Cold: nothing compiled yet; warm: machine code on disk."""

    cold: Start | None
    """None if it was left out."""
    warm: Start
    rest: Start | None = None
    """What compiles meanwhile, after a cold start: the other integrators, laws and sampled control."""


def start_times(cold: bool) -> StartTimes:
    """Measure a warm start, and a cold one if asked for (it compiles everything: tens of seconds)."""
    warm = min((_start(dict(os.environ)) for _ in range(2)), key=_cpu)
    if not cold:
        return StartTimes(None, warm)
    with tempfile.TemporaryDirectory(prefix="flexlab-bench-") as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": str(Path(folder))}
        return StartTimes(_start(environment), warm, Start(*run_probe(EVERYTHING, environment)))


def _cpu(start: Start) -> float:
    return start.cpu


def _start(environment: dict[str, str]) -> Start:
    return Start(*run_probe(PROBE, environment))


def run_probe(program: str, environment: dict[str, str]) -> list[float]:
    """The JSON list that a Python program prints in a fresh interpreter. Raises `StudyError` if it fails."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", program],
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=LONGEST_START,
            check=True,
        )
        return json.loads(done.stdout)
    except (subprocess.SubprocessError, OSError, ValueError) as error:
        detail = getattr(error, "stderr", None) or str(error)
        raise StudyError(f"A fresh interpreter for the measurement failed: {str(detail).strip()[-300:]}") from None
