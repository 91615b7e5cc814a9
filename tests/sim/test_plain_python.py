"""The debug path: with NUMBA_DISABLE_JIT=1, every kernel is its plain Python function."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flexlab.control.law import laws
from flexlab.control.path import paths
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
OWN_LAWS, OWN_PATHS = "flexlab.control.laws.", "flexlab.control.paths."
"""Where flexlab's own are; other tests may have added theirs."""
STEPS = {"etdrk4": 5e-4, "rk4": 2e-4, "generalized-alpha": 5e-4}


def in_plain_python(program: str, *words: str, folder: Path | None = None) -> str:
    """What a program prints in a new process without compilation."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", program, *words],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def test_two_ticks_of_every_law_path_and_integrator_agree_with_the_machine_code():
    kinds = [(kind, "etdrk4") for kind, law in laws().items() if law.model.__module__.startswith(OWN_LAWS)]
    kinds += [("adaptive-sliding-mode", integrator) for integrator in STEPS if integrator != "etdrk4"]
    cases = [
        {
            "controller.kind": kind,
            "simulation.integrator": integrator,
            "simulation.step": STEPS[integrator],
            "controller.control_period": period,
        }
        for kind, integrator in kinds
        for period in ((None, 0.001) if kind != "lqr" else (0.001,))
    ]
    # Only the first has an automatic step: for some of the others, plain Python takes seconds to choose it.
    cases += [
        {"trajectory": {"kind": kind}, **({"simulation.step": STEPS["etdrk4"]} if number else {})}
        for number, (kind, path) in enumerate(paths().items())
        if path.model.__module__.startswith(OWN_PATHS)
    ]
    for changes, poses in zip(cases, json.loads(in_plain_python(PROGRAM, json.dumps(cases))), strict=True):
        compiled = World(load_preset("paper").replace(changes)).run(2).pose
        np.testing.assert_allclose(poses, compiled, rtol=0, atol=1e-13, err_msg=str(changes))


LAW_WITH_METHOD_NAMES = """
from typing import Literal

from flexlab.compiled import pluggable
from flexlab.control.controller import Controller
from flexlab.control.law import Law
from flexlab.quantities import Number, Triple, quantity


class MethodNames(Controller):
    kind: Literal["method-names"] = "method-names"
    size: Number = quantity(3000.0, title="Size", symbol="s", unit="N/m", low=0, high=1e6)
    mean: Triple = quantity((100.0, 100.0, 10.0), title="Mean", symbol="m", unit="N·s/m", low=0, high=1e6)
    T: Number = quantity(0.5, title="T", symbol="T", unit="1", low=0, high=1)


@pluggable
def drive(gains, now, memory, memory_rate, signals):
    for i in range(now.arm_count):
        for a in range(3):
            now.u[i, a] = -gains.T * (gains.size * (now.x[a] - now.desired[0, a]) + gains.mean[a] * now.v[a])


@pluggable
def fastest_rate(gains, now, memory, S, kappa):
    return gains.size / gains.mean[0]


LAW = Law(MethodNames, drive, fastest_rate)
"""
PATH_WITH_METHOD_NAMES = """
from typing import Literal

from flexlab.compiled import pluggable
from flexlab.control.path import Path, Trajectory
from flexlab.quantities import Number, quantity


class Shapes(Trajectory):
    kind: Literal["shapes"] = "shapes"
    shape: Number = quantity(0.1, title="Shape", symbol="s", unit="m/s", low=-1, high=1)
    max: Number = quantity(0.75, title="Largest", symbol="m", unit="m", low=-1, high=1)

    @property
    def span(self):
        return 0.1


@pluggable
def follow(path, rows, t, desired):
    desired[0, 0], desired[0, 1], desired[0, 2] = path.shape * t, path.max, 0.0
    desired[1, 0], desired[1, 1], desired[1, 2] = path.shape, 0.0, 0.0
    desired[2, 0], desired[2, 1], desired[2, 2] = 0.0, 0.0, 0.0


PATH = Path(Shapes, follow)
"""
WITH_METHOD_NAMES = """
import json, sys
from pathlib import Path
from flexlab.control.law import add_law_file
from flexlab.control.path import add_path_file
from flexlab.presets import load_preset
from flexlab.sim.world import World

kinds = {"controller.kind": add_law_file(Path("law.py")).kind, "trajectory.kind": add_path_file(Path("path.py")).kind}
run = World(load_preset("paper").replace({**kinds, "simulation.integrator": "rk4", "simulation.step": 2e-4})).run(3)
print(json.dumps([run.pose.tolist(), run.desired_pose.tolist(), run.joint_torque.tolist()]))
"""


def test_gains_and_options_may_be_named_like_methods_of_arrays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "law.py").write_text(LAW_WITH_METHOD_NAMES, encoding="utf-8")
    (tmp_path / "path.py").write_text(PATH_WITH_METHOD_NAMES, encoding="utf-8")
    plain = json.loads(in_plain_python(WITH_METHOD_NAMES, folder=tmp_path))
    monkeypatch.chdir(tmp_path)
    exec(WITH_METHOD_NAMES, {})
    for compiled, interpreted in zip(json.loads(capsys.readouterr().out), plain, strict=True):
        np.testing.assert_allclose(interpreted, compiled, rtol=0, atol=1e-9)


def test_a_recording_of_the_first_format_opens_in_plain_python(root: Path):
    path = root / "tests/recording/golden/format-1/paper.rrd"
    program = f"from flexlab.recording.reader import read_recording; print(len(read_recording({str(path)!r}).samples))"
    assert in_plain_python(program) == "554\n"
