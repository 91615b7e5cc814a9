"""Warnings about what the beam's model neglects."""

import re

import numpy as np
import pytest
from waiting import wait_until

from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.run_warnings import ModelWarning
from flexlab.sim.runner import Runner
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World


@pytest.mark.parametrize("stiffness", [127.0, 1.0])
def test_a_warning_tells_when_the_beam_was_pressed_and_the_force_of_that_time(stiffness: float) -> None:
    """After a change of EI it said that the beam "is pressed", and of the new buckling load: 2460 N instead of 24.6 N."""
    scenario = load_preset("soft-beam").replace({"controller.wanted_internal_force": 20.0})
    change = (1.0, ChangeScenario({"payload.bending_stiffness": stiffness}))
    run = simulate(scenario, 2.0, 0.001, [change])
    loads = [np.pi**2 * EI / 0.5**2 for EI in (1.27, stiffness)]
    shares = [float(run.axial_load_share[part].max()) for part in (run.time <= 1.0, run.time > 1.0)]
    at = int(np.argmax(shares))
    said = r"The beam was pressed with up to ([\d.]+) N along it, at t = ([\d.]+) s, (\d+) % of its buckling load: "
    force, time, percent = re.findall(said, run.status.text)[0]
    assert float(time) == pytest.approx(run.time[np.argmax(run.axial_load_share)], abs=1e-9)
    assert float(force) == pytest.approx(loads[at] * shares[at], rel=0.006)
    assert int(percent) == round(100 * shares[at])


def test_a_warning_ends_with_the_model_that_it_is_about_and_the_run_still_tells_of_it() -> None:
    """A beam that was pressed without axial load was said to buckle once it felt it, and the other way round."""
    world = World(load_preset("soft-beam").replace({"controller.wanted_internal_force": 60.0}))
    world.advance(300)
    assert "a real beam would have buckled" in world.model_warning.text
    pressed = world.warnings
    world.apply(ChangeScenario({"payload.axial_load": "first-order", "controller.wanted_internal_force": 0.0}))
    assert world.model_warning == ModelWarning()
    world.advance(10)
    assert world.model_warning == ModelWarning()
    assert world.warnings == pressed
    world.apply(ChangeScenario({"controller.wanted_internal_force": 60.0}))
    world.advance(20)
    assert "it buckles" in world.model_warning.text
    world.apply(ChangeScenario({"payload.axial_load": "none", "controller.wanted_internal_force": 0.0}))
    assert "buckle" not in world.model_warning.text


@pytest.mark.parametrize(
    ("cause", "cure", "words"),
    [
        ({"joints.encoders.counts": (1e5,) * 3}, {"joints.encoders.counts": (0.0,) * 3}, "one count of the encoders"),
        (
            {"controller.kind": "sliding-mode", "controller.control_period": 0.02, "controller.boundary_layer": 0.05},
            {"controller.control_period": 0.001},
            "Results depend on rounding",
        ),
    ],
)
def test_a_warning_ends_with_the_change_that_removes_its_cause(cause: dict, cure: dict, words: str) -> None:
    scenario = load_preset("paper").replace({"controller.control_period": 0.001, **cause})
    runner = Runner(scenario, playing=False, clock=lambda: 0.0)
    run = runner._run
    while words not in run.world.accuracy_warning:
        assert run.world.time < 1.0
        run.advance(50)
    asked = runner.submit(ChangeScenario(cure))

    def is_made() -> bool:
        runner.frame()
        return runner.snapshot.answered >= asked

    wait_until(is_made, "the change, whose kernels are made ready beside the run")
    assert runner.snapshot.accuracy_warning == ""
    run.advance(20)
    assert words not in run.world.accuracy_warning
    assert words in run.world.warnings
    assert all(event.text for event in run.events), "the end of a warning is no event"
