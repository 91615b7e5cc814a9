"""Fine meshes of which only the lowest modes are kept."""

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

DAMPING = {"nodal": {"kind": "nodal", "coefficient": 0.1}, "modal": {"kind": "modal", "ratio": 0.01}}


def fine(damping: str, **changes) -> Scenario:
    base = {"payload.element_count": 32, "payload.damping": DAMPING[damping], "simulation.step": 1.25e-4}
    return load_preset("paper").replace(base | changes)


def run(scenario: Scenario) -> Samples:
    world = World(scenario)
    samples = world.run(600)
    assert world.status == "running", world.status.text
    return samples


@pytest.mark.parametrize("damping", DAMPING)
def test_four_modes_of_thirty_two_elements_give_the_same_pose(damping: str):
    """The pose moves by at most 1e-8 m: the controller keeps the full hᵀM_q⁻¹h terms."""
    whole, kept = run(fine(damping)), run(fine(damping, **{"payload.mode_count": 4}))
    assert np.abs(kept.pose - whole.pose).max() < 1e-8
    assert np.abs(kept.midspan_deflection - whole.midspan_deflection).max() < 2e-6


def test_the_error_of_the_pose_falls_with_the_number_of_kept_modes():
    whole = run(fine("modal"))
    gaps = [np.abs(run(fine("modal", **{"payload.mode_count": k})).pose - whole.pose).max() for k in (1, 2, 4, 8)]
    assert np.all(np.diff(gaps) < 0), gaps


def test_the_controller_knows_the_whole_beam_whatever_the_plant_keeps():
    """hᵀM_q⁻¹h of the law is that of all modes; that of the plant is smaller."""
    whole, kept = World(fine("modal")).system, World(fine("modal", **{"payload.mode_count": 1})).system
    np.testing.assert_allclose(kept.control.payload.kappa, whole.control.payload.kappa, rtol=1e-12)
    assert kept.plant.kappa[0] < 0.9 * whole.plant.kappa[0]
    assert kept.plant.modal.shape[1] == 1


def test_keeping_as_many_modes_as_there_are_truncates_nothing():
    paper = load_preset("paper")
    a, b = World(paper).run(50), World(paper.replace({"payload.mode_count": 4})).run(50)
    np.testing.assert_array_equal(a.pose, b.pose)
