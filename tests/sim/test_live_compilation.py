"""Kernels not yet compiled are compiled beside the running world, and all can be compiled beforehand."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import config

from flexlab.compiled import PLAIN_PYTHON, engine, is_warm
from flexlab.control.law import laws
from flexlab.presets import load_preset
from flexlab.sim import assembly
from flexlab.sim.assembly import Unprepared
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.compile_all import WHILE_OPEN, compile_everything, is_everything_compiled
from flexlab.sim.sampled_control import loop_variant, variant_of
from flexlab.sim.step_trial import build_assembly
from flexlab.sim.world import World


@pytest.mark.parametrize(
    "changes", [{"controller.kind": "computed-torque"}, {"simulation.integrator": "rk4", "simulation.step": 1e-4}]
)
def test_the_simulation_thread_never_compiles(changes: dict, monkeypatch: pytest.MonkeyPatch, same_bits):
    """It raises `Unprepared`; once the kernels are prepared, the change is applied as always."""
    expected = World(load_preset("paper"))
    expected.apply(ChangeScenario(changes))
    world = World(load_preset("paper"))
    vars(laws()["computed-torque"]).pop("addresses", None)
    monkeypatch.setattr(assembly, "_loaded", {("etdrk4", True)})
    with pytest.raises(Unprepared) as need:
        world.apply(ChangeScenario(changes), at_once=True)
    prepared = build_assembly(need.value.scenario, world.tick_period, [world.assembly])
    world.apply(ChangeScenario(changes), [prepared], at_once=True)
    same_bits(world.advance(20), expected.advance(20))


EXTENSIONS = [
    {"grips.model": "compliant"},
    {"joints.friction.viscous": (1.0, 1.0, 1.0)},
    {"payload.mass_change.factor": 2.0},
]


@pytest.mark.parametrize("changes", EXTENSIONS)
def test_a_changed_plant_needs_the_same_kernels_as_one_built_anew(changes: dict) -> None:
    plain = load_preset("paper")
    known: list[assembly.Assembly] = []
    for scenario in (plain, plain.replace(changes), plain):
        known = [build_assembly(scenario, 1e-3, known)]
        assert loop_variant(known[0].system.plant) == variant_of(scenario)


def test_everything_can_be_compiled_beforehand():
    compile_everything()
    assert is_everything_compiled()
    assert all(law.is_loaded for law in laws().values())


LATER = """
import sys
from pathlib import Path

opened = set()
sys.addaudithook(lambda event, given: opened.add(Path(str(given[0])).name) if event == "open" else None)

from flexlab.analysis.modes import modes
from flexlab.presets import load_preset, preset_names
from flexlab.sim.compile_all import compile_everything
from flexlab.sim.world import World

compile_everything()
compiled = set(opened)
for name in preset_names():
    World(load_preset(name)).run(1)
    modes(load_preset(name))
print(*sorted(name for name in opened - compiled if name.endswith(".nbc")))
"""


@pytest.mark.skipif(PLAIN_PYTHON, reason="nothing is compiled")
def test_a_lab_with_any_preset_needs_no_further_kernels(tmp_path: Path):
    """The lab also shows the modes of its scenario; it used to compile their kernels itself, once on each machine."""
    done = subprocess.run([sys.executable, "-c", LATER], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.skipif(PLAIN_PYTHON, reason="nothing is compiled")
def test_machine_code_of_another_python_or_processor_does_not_count(monkeypatch: pytest.MonkeyPatch):
    """Machines share home folders, which outlive a version of Python. Results and the engine's name are the same everywhere."""
    World(load_preset("paper"))
    name = engine()
    assert is_warm()
    with monkeypatch.context() as another:
        another.setattr(sys.implementation, "cache_tag", "cpython-399")
        assert not is_warm()
        assert not is_everything_compiled()
    monkeypatch.setattr(config, "CPU_NAME", "another")
    assert not is_warm()
    assert not is_everything_compiled()
    assert engine() == name


def test_compiling_for_a_lab_ends_with_the_lab_however_that_ends(tmp_path: Path):
    """A killed lab cannot say so, but the system closes its end of the pipe."""
    program = [sys.executable, "-m", "flexlab.sim.compile_all", WHILE_OPEN]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run(program, stdin=subprocess.DEVNULL, env=environment, check=False)
    assert done.returncode == 1
    assert not list(tmp_path.rglob("everything"))
