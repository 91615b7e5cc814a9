"""Costs on the simulation thread of the live lab: of a live change, and of a law that another program computes."""

import re
import subprocess
import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexlab.assets import web_assets_folder
from flexlab.errors import ScenarioError
from flexlab.own import hosts
from flexlab.own.files import law_kind
from flexlab.presets import load_preset
from flexlab.sim.assembly import Unprepared
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.step_trial import build_assembly
from flexlab.sim.world import World

MESHES = (2, 8, 64)  # elements
LIGHT_GOAL, BEAM_GOAL, FRAME_GOAL = 0.3, 2.0, 50.0
"""Goals, ms: gains, path and gravity on the paper's mesh; its beam; any change on the finest mesh."""
CHANGES: dict[str, tuple[Any, Any]] = {
    "controller.feedback_gain": (200.0, 201.0),
    "trajectory.amplitude": ((0.2, 0.2, 0.2), (0.2, 0.2, 0.19)),
    "gravity": (0.0, 1.0),
    "controller.torque_limit": (None, (500.0, 500.0, 500.0)),
    "payload.bending_stiffness": (100.0, 90.0),
    "payload.linear_density": (2.0, 2.1),
    "payload.damping.coefficient": (0.1, 0.12),
}
"""A field of each kind, with two values between which it changes."""
BEAM = "payload."


@dataclass(frozen=True)
class ChangeCost:
    """The cost of one change of one field."""

    elements: int
    path: str
    ms: float
    """Processor time on the simulation thread, ms, checks included."""
    ms_beside: float
    """Processor time beside that thread, to prepare the change, ms; 0 if nothing is prepared."""

    @property
    def is_light(self) -> bool:
        """Whether the beam stays the same."""
        return not self.path.startswith(BEAM)


def change_costs(repeats: int) -> list[ChangeCost]:
    """The lowest cost in `repeats` changes of each kind on each mesh."""
    costs = []
    for elements in MESHES:
        world = World(load_preset("paper").replace({"payload.element_count": elements}))
        world.advance(5)
        for path, values in CHANGES.items():
            # The first round fills caches of numpy and pydantic.
            rounds = [_change(world, path, values[(k + 1) % 2]) for k in range(repeats + 1)]
            ms, beside = (1e3 * min(part) for part in zip(*rounds[1:], strict=True))
            costs.append(ChangeCost(elements, path, ms, beside))
    return costs


def _change(world: World, path: str, value: Any) -> tuple[float, float]:
    """Processor times, s, on the simulation thread and beside it, of a change as the live lab carries it out."""
    command, beside = ChangeScenario({path: value}), 0.0
    start = time.thread_time()
    try:
        world.apply(command, at_once=True)
    except Unprepared as need:
        begun = time.thread_time()
        prepared = build_assembly(need.scenario, world.tick_period, [world.assembly])
        beside = time.thread_time() - begun
        world.apply(command, [prepared], at_once=True)
    world.observe()
    taken = time.thread_time() - start - beside
    world.advance(3)
    return taken, beside


WARM = 100
"""Number of instants before the measured ones."""
RUN = "gravity"  # the preset


@dataclass(frozen=True)
class RoundTrip:
    """Wall time of a control period of 1 ms, under the machine's load: to the program and back, and the engine's step."""

    instants: int
    p50_ms: float
    p99_ms: float


def measure_round_trip(instants: int) -> RoundTrip | None:
    """Measure the example law in a Python program; None if it cannot be started."""
    file = web_assets_folder() / "examples" / "controller.py"
    with subprocess.Popen([sys.executable, str(file), "0"], stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        try:
            found = re.search(r"tcp://\S+", program.stdout.readline())
            if found is None:
                return None
            world = World(load_preset(RUN).replace({"controller.kind": law_kind(found[0])}))
            world.advance_rows(WARM)
            instant = [time.perf_counter()]
            for _ in range(instants):
                world.advance_rows(1)
                instant.append(time.perf_counter())
        except ScenarioError:
            return None
        finally:
            hosts.close_all()
            program.kill()
    if world.status.failed:
        return None
    return RoundTrip(instants, *(1e3 * np.percentile(np.diff(instant), [50, 99])).tolist())
