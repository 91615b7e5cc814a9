"""The debug path: with NUMBA_DISABLE_JIT=1 every kernel is the Python function that it is written as."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from flexlab.control.law import laws
from flexlab.presets import load_preset
from flexlab.sim.world import World

PROGRAM = """
import json, sys
from flexlab.presets import load_preset
from flexlab.sim.world import World

poses = []
for changes in json.loads(sys.argv[1]):
    poses.append(World(load_preset("paper").replace(changes)).run(2).pose.tolist())
print(json.dumps(poses))
"""
STEPS = {"etdrk4": 5e-4, "rk4": 2e-4, "generalized-alpha": 5e-4}


def test_two_ticks_of_every_law_and_integrator_are_those_of_the_machine_code():
    cases = [
        {
            "controller.kind": kind,
            "simulation.integrator": integrator,
            "simulation.step": step,
            "controller.control_period": period,
        }
        for kind, law in laws().items()
        if law.model.__module__.startswith("flexlab.control.laws.")  # Other tests may have added theirs.
        for integrator, step in STEPS.items()
        for period in ((None, 0.001) if kind != "lqr" else (0.001,))
    ]
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROGRAM, json.dumps(cases)],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    for changes, poses in zip(cases, json.loads(done.stdout), strict=True):
        compiled = World(load_preset("paper").replace(changes)).run(2).pose
        np.testing.assert_allclose(poses, compiled, rtol=0, atol=1e-13, err_msg=str(changes))


@pytest.mark.parametrize("name", ["find_state", "rates"])
def test_an_inlined_kernel_is_no_machine_code_of_its_own(name: str):
    """`numba_internals` still does what it is there for: inner kernels have been typed, but have nothing to call."""
    from flexlab.numba_internals import NOWHERE, BitcodeLibrary
    from flexlab.sim import closed_loop

    World(load_preset("paper").replace({"simulation.integrator": "rk4", "simulation.step": 1e-4})).run(1)
    kernel = getattr(closed_loop, name)
    assert NOWHERE == 1
    for result in kernel._dispatcher.overloads.values():
        assert isinstance(result.library, BitcodeLibrary)
