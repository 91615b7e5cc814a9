"""Compile, once per machine, what the first picture does not need: other integrators, laws, paths, sampled control, joints.

`python -m flexlab.sim.compile_all` does so in one process per core. The lab starts a single process beside itself, so that what
somebody chooses later is already on disk.
"""

import multiprocessing
import os
import sys
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import combinations
from typing import Any

from flexlab.compiled import PLAIN_PYTHON, cache_folder
from flexlab.control.law import laws
from flexlab.control.path import paths
from flexlab.machine import cores, give_way
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.integrators.scheme import ORDER
from flexlab.sim.world import World

DONE = "everything"
"""Name of the file in the cache folder that says that everything is compiled."""
WHILE_OPEN = "--while-open"
"""Argument of a process that must end when its standard input ends, finished or not."""
JOINTS = {"joints.friction.viscous": (1.0, 1.0, 1.0)}
AXIAL = {"payload.axial_load": "first-order"}
SHAPED = {"trajectory.shaper": "zvd"}
"""A shaped path needs the rates by themselves for its first mode, as does the rest point that every lab looks for."""
FURTHER = {"payload.mass_change.factor": 2.0}, {"grips.model": "compliant"}, JOINTS
"""Extensions of the paper's plant: the loop is compiled for each combination of them, always with the axial load."""
CHANGE = ChangeScenario({"controller.feedback_gain": 201.0})
PATIENCE = 15
"""Niceness of the process: everything else on the machine takes precedence (`nice`)."""


def is_everything_compiled() -> bool:
    """Whether everything is compiled for the present sources."""
    return PLAIN_PYTHON or (cache_folder() / DONE).exists()


def compile_everything(processes: int = 1) -> None:
    """Compile what is not yet on disk, in the order in which it is likely to be needed, or in several processes at once.

    Numba compiles one kernel at a time in a process. Raises what compiling raises.
    """
    if processes == 1:
        for part in PARTS:
            part()
    else:
        with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
            for compiled in [pool.submit(part) for part in PARTS]:
                compiled.result()
    (cache_folder() / DONE).touch()


def _compile_paper() -> None:
    """The paper's plant with every integrator and with sampled control; all laws and paths."""
    World(Scenario()).apply(CHANGE)
    _compile_loop({})
    for law in laws().values():
        _ = law.addresses
    for path in paths().values():
        _ = path.address


def _compile_loop(changes: Mapping[str, Any]) -> None:
    """A changed plant with every integrator and with sampled control."""
    scenario = _compile_plant(changes)
    for name in ORDER:
        World(scenario.replace({"simulation.integrator": name, "simulation.step": 1e-5})).run(1)


def _compile_plant(changes: Mapping[str, Any]) -> Scenario:
    """A changed plant with sampled control, and with a law that looks at the plant before it begins; returns its scenario."""
    scenario = Scenario().replace({**changes, **SHAPED})
    World(scenario.replace({"controller.kind": "regressor-adaptive"}))
    world = World(scenario.replace({"controller.control_period": 0.001}))
    world.run(1)
    world.apply(CHANGE)
    return scenario


PARTS: tuple[Callable[[], object], ...] = (
    _compile_paper,
    partial(_compile_loop, JOINTS),
    partial(_compile_loop, AXIAL),
    *(
        partial(_compile_plant, {name: value for part in parts for name, value in part.items()})
        for count in range(1, len(FURTHER) + 1)
        for parts in combinations(FURTHER, count)
    ),
)
"""The parts that can be compiled independently."""


def _end_with_the_input() -> None:
    sys.stdin.buffer.read()
    os._exit(1)


if __name__ == "__main__":
    give_way(PATIENCE)
    beside_a_lab = WHILE_OPEN in sys.argv
    if beside_a_lab:
        threading.Thread(target=_end_with_the_input, name="flexlab-starter", daemon=True).start()
    compile_everything(1 if beside_a_lab else cores())
