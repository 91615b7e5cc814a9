"""The compiled code holds no global lock, allocates nothing, and needs no compilation on a warm start."""

import json
import os
import subprocess
import sys
import threading
import time

import numba
import numpy as np
import pytest

from flexlab.compiled import compiled
from flexlab.presets import load_preset
from flexlab.sim.advance import INTERRUPTED
from flexlab.sim.stepping import move_on
from flexlab.sim.world import World

WARM = """
import json
import numba
from numba.core.registry import CPUDispatcher
import flexlab
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.world import World

for preset, arms in (("paper", 2), ("single-arm", 1)):
    for integrator in ("rk4", "etdrk4", "generalized-alpha"):
        world = World(flexlab.load_preset(preset).replace({"simulation.integrator": integrator}))
        world.advance(2)
        for kind in ("pd", "computed-torque", "vibration-damping", "none", "adaptive-sliding-mode"):
            world.apply(ChangeScenario({"controller.kind": kind, "controller.control_period": 0.001}))
            world.advance(2)
        world.apply(Tap(0.0, (0.01, 0.0)))
        world.apply(Pull(0.0, (0.0, 0.8), 10.0))
        world.apply(ChangeScenario({"payload.element_count": 4}))
        world.advance(2)
        world.restore(world.state())
        world.run(2)

import gc
stats = {d.py_func.__qualname__: [sum(d.stats.cache_hits.values()), sum(d.stats.cache_misses.values())]
         for d in gc.get_objects() if isinstance(d, CPUDispatcher) and d.py_func.__module__.startswith("flexlab")}
print(json.dumps(stats))
"""


def use_everything() -> dict[str, list[int]]:
    """Cache hits and misses per kernel of a fresh process that uses all integrators, laws and commands."""
    done = subprocess.run(
        [sys.executable, "-c", WARM], capture_output=True, text=True, check=True, timeout=600, env=os.environ.copy()
    )
    return json.loads(done.stdout)


def test_a_warm_start_compiles_nothing():
    """The second process at the latest loads every kernel from the cache: no miss in any dispatcher, and some hits."""
    stats = use_everything()
    if any(misses for _, misses in stats.values()):
        stats = use_everything()
    assert {name: misses for name, (_, misses) in stats.items() if misses} == {}
    assert stats["advance"][0] > 0


def test_kernels_run_without_the_global_lock():
    """Another thread sees the first row of a single kernel call that would take seconds, and interrupts it."""
    world = World(load_preset("paper").replace({"simulation.step": 2e-6}))
    world.advance(1)
    rows = world.new_rows(10_000)

    def interrupt() -> None:
        while not rows[0].any():
            time.sleep(1e-3)
        world.interrupt()

    threading.Thread(target=interrupt, daemon=True).start()
    _, code = move_on(world._motion, rows)
    assert code == INTERRUPTED


def test_a_kernel_that_allocates_does_not_compile():
    """Reference counting is off, so that nothing can be allocated inside the engine's loops."""

    def greedy(n):
        return np.zeros(n)

    with pytest.raises(numba.core.errors.NumbaError):
        compiled(greedy)(3)


def test_plain_python_computes_what_the_machine_code_does():
    """`.py_func` is the debug path: one call of an inner function agrees to rounding."""
    from flexlab.physics.dynamics import set_momenta
    from flexlab.physics.plant import make_workspace

    world = World(load_preset("paper"))
    world.advance(13)
    y = world.state().y
    sample = world.observe()
    results = []
    for function in (set_momenta, set_momenta.py_func):
        own = y.copy()
        workspace = make_workspace(2, 4)
        function(world.system.plant, own, sample.pose_rate[0].copy(), np.array([0.1, -0.2, 0.3, 0.4]), workspace)
        results.append(own[:19])
    np.testing.assert_allclose(results[0], results[1], rtol=1e-12, atol=1e-12)
