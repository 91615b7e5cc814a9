"""What a control law costs that a program elsewhere computes: one message each way per control instant, on this machine."""

import re
import subprocess
import sys
import time
from dataclasses import dataclass

import numpy as np

from flexlab.assets import web_assets_folder
from flexlab.errors import ScenarioError
from flexlab.own import hosts
from flexlab.own.files import law_kind
from flexlab.presets import load_preset
from flexlab.sim.world import World

WARM = 100
"""Instants before those that are timed."""
RUN = "gravity"
"""The preset."""


@dataclass(frozen=True)
class RoundTrip:
    """Wall time of a control period of 1 ms, with all the machine's load: to the program and back, and the engine's step."""

    instants: int
    p50_ms: float
    p99_ms: float


def measure_round_trip(instants: int) -> RoundTrip | None:
    """Of the example in Python; None where it cannot be had."""
    file = web_assets_folder() / "examples" / "controller.py"
    with subprocess.Popen([sys.executable, str(file), "0"], stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        try:
            found = re.search(r"tcp://\S+", program.stdout.readline())
            if found is None:
                return None
            world = World(load_preset(RUN).replace({"controller.kind": law_kind(found[0])}))
            world.advance_rows(WARM)
            times = np.array([_timed(world) for _ in range(instants)])
        except ScenarioError:
            return None
        finally:
            hosts.close_all()
            program.kill()
    if world.status.failed:
        return None
    return RoundTrip(instants, *(1e3 * np.percentile(times, [50, 99])).tolist())


def _timed(world: World) -> float:
    """s of one tick."""
    before = time.perf_counter()
    world.advance_rows(1)
    return time.perf_counter() - before
