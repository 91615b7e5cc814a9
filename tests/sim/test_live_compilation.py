"""What has not been compiled yet is compiled beside the running world, and everything can be compiled beforehand."""

import pytest

from flexlab.control.law import laws
from flexlab.presets import load_preset
from flexlab.sim import assembly
from flexlab.sim.assembly import Unprepared, build_assembly
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.compile_all import compile_everything, is_everything_compiled
from flexlab.sim.world import World


@pytest.mark.parametrize(
    "changes", [{"controller.kind": "computed-torque"}, {"simulation.integrator": "rk4", "simulation.step": 1e-4}]
)
def test_the_simulation_thread_never_compiles(changes: dict, monkeypatch: pytest.MonkeyPatch, same_bits):
    """It says that there is something to prepare; once prepared, the change is taken on as always."""
    expected = World(load_preset("paper"))
    expected.apply(ChangeScenario(changes))
    world = World(load_preset("paper"))
    vars(laws()["computed-torque"]).pop("addresses", None)
    monkeypatch.setattr(assembly, "_loaded", {"etdrk4"})
    with pytest.raises(Unprepared) as need:
        world.apply(ChangeScenario(changes), at_once=True)
    prepared = build_assembly(need.value.scenario, world.tick_period, [world.assembly])
    world.apply(ChangeScenario(changes), [prepared], at_once=True)
    same_bits(world.advance(20), expected.advance(20))


def test_everything_can_be_compiled_beforehand():
    compile_everything()
    assert is_everything_compiled()
    assert all(law.is_loaded for law in laws().values())
