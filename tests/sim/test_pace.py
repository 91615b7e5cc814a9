"""Runs that are slower than real time are announced when their step is chosen, with what to change."""

import pytest

from flexlab.presets import load_preset, preset_names
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.run_warnings import SLOWEST_PACE, seconds_per_second
from flexlab.sim.runner import Runner
from flexlab.sim.world import World

DENSE = {"payload.element_count": 64, "payload.damping": {"kind": "nodal", "coefficient": 0.1}}


def announced(changes: dict, preset: str = "paper") -> str:
    return World(load_preset(preset).replace(changes)).pace_warning


@pytest.mark.parametrize(
    ("changes", "cause", "cure"),
    [
        (DENSE, "the damping couples its 128 modes", "damping of kind modal or stiffness, which couples none"),
        ({"simulation.integrator": "rk4", "payload.bending_stiffness": 1e6}, "with rk4", "the integrator auto"),
        (
            {"simulation.step": 1e-6},
            "the step is set to 10⁻⁶ s (simulation.step)",
            "a longer step (simulation.step), or null",
        ),
    ],
)
def test_a_slow_scenario_is_announced_with_its_cause_and_cure(changes: dict, cause: str, cure: str):
    text = announced(changes, "single-arm")
    assert text.startswith("Slower than real time: a simulated second takes about ")
    assert cause in text.partition("To keep up")[0]
    assert cure in text.partition("To keep up")[2]


def test_the_suggested_changes_make_a_run_faster():
    world = World(load_preset("single-arm").replace(DENSE))
    modal = World(world.scenario.replace({"payload.damping": {"kind": "modal", "ratio": 0.01}}))
    fewer = World(modal.scenario.replace({"payload.mode_count": 8}))
    paces = [seconds_per_second(each.assembly, each.step) for each in (world, modal, fewer)]
    assert paces[0] > 2 * paces[1] > 4 * paces[2]
    assert paces[2] < SLOWEST_PACE


@pytest.mark.parametrize(
    ("changes", "ratio"),
    [
        ({"grips.model": "compliant"}, 1.73),
        ({"joints.friction.viscous": (5.0, 5.0, 2.0)}, 1.28),
        ({"joints.motor.time_constant": 0.004}, 1.26),
        ({"controller.control_period": 1e-3, "joints.encoders.counts": (2e4, 2e4, 1e4)}, 1.2),
        ({"payload.axial_load": "first-order"}, 1.3),
        ({"payload.axial_load": "first-order", "payload.element_count": 8}, 1.55),
        ({"payload.mass_change.factor": 1.5}, 1.05),
        (
            {"grips.model": "compliant", "payload.axial_load": "first-order", "joints.friction.viscous": (5.0,) * 3},
            2.16,
        ),
    ],
)
def test_the_estimate_counts_what_an_extension_costs(changes: dict, ratio: float):
    """Ratios to the paper's step of rk4 as measured, the least of 25 times each; compliant grips were estimated at 1."""
    plain = {"simulation.integrator": "rk4", "simulation.step": 2e-6}
    mesh = {"payload.element_count": changes.get("payload.element_count", 2)}
    worlds = [World(load_preset("paper").replace({**plain, **mesh, **more})) for more in ({}, changes)]
    without, found = (seconds_per_second(world.assembly, world.step) for world in worlds)
    assert found / without == pytest.approx(ratio, rel=0.15)


@pytest.mark.parametrize("name", preset_names())
def test_no_preset_is_slow(name: str):
    assert announced({}, name) == ""


def test_the_runner_announces_a_start_and_a_change_once():
    runner = Runner(load_preset("paper"), playing=False, clock=lambda: 0.0)
    assert runner.snapshot.pace_warning == ""
    slow = Runner(load_preset("paper").replace({"simulation.step": 1e-6}), playing=False, clock=lambda: 0.0)
    for each in (runner, slow):
        each.submit(ChangeScenario({"simulation.step": 1e-6}))
        each.frame()
        each.submit(ChangeScenario({"controller.feedback_gain": 210.0}))
        each.frame()
        told = [event for event in each.snapshot.events if event.level == "warning"]
        assert [event.text for event in told] == [each.snapshot.pace_warning]
        each.submit(ChangeScenario({"simulation.step": None}))
        each.frame()
        assert each.snapshot.pace_warning == ""
