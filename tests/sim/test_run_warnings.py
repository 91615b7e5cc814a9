"""Warnings about what the beam's model neglects."""

import re

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate


@pytest.mark.parametrize("stiffness", [127.0, 1.0])
def test_a_warning_tells_when_the_beam_was_pressed_and_the_force_of_that_time(stiffness: float) -> None:
    """After a change of EI it said that the beam "is pressed", and of the new buckling load: 2460 N instead of 24.6 N."""
    scenario = load_preset("soft-beam").replace({"controller.wanted_internal_force": 20.0})
    change = (1.0, ChangeScenario({"payload.bending_stiffness": stiffness}))
    run = simulate(scenario, 2.0, 0.001, [change])
    loads = [np.pi**2 * EI / 0.5**2 for EI in (1.27, stiffness)]
    shares = [float(run.axial_load_share[part].max()) for part in (run.time <= 1.0, run.time > 1.0)]
    at = int(np.argmax(shares))
    said = r"At t = ([\d.]+) s the beam was pressed with ([\d.]+) N along it, (\d+) % of its buckling load: "
    time, force, percent = re.findall(said, run.status.text)[0]
    assert float(time) == pytest.approx(run.time[np.argmax(run.axial_load_share)], abs=1e-9)
    assert float(force) == pytest.approx(loads[at] * shares[at], rel=0.006)
    assert int(percent) == round(100 * shares[at])
