"""The controller's model of the payload changes what the controller does, never the payload itself."""

import numpy as np
import pytest

from flexlab.control.observers.believed_plant import believed_plant
from flexlab.presets import load_preset
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

FACTORS = {
    "controller.model.linear_density_factor": 2.0,
    "controller.model.length_factor": 0.6,
    "controller.model.stiffness_factor": 1.7,
}


def test_the_plant_is_the_same_whatever_the_controller_believes():
    """All constants of the plant are the same to the last bit."""
    paper = load_preset("paper")
    plain, other = World(paper).system.plant, World(paper.replace(FACTORS)).system.plant
    for name, a, b in zip(plain._fields, plain, other, strict=True):
        assert np.array_equal(a, b), name


def test_with_the_motors_off_the_belief_changes_nothing():
    """The run is the same to the last bit."""
    free = load_preset("paper").replace({"controller.kind": "none", "initial.pose_rate": (0.1, 0.0, 0.1)})
    plain, other = simulate(free, 0.2), simulate(free.replace(FACTORS), 0.2)
    assert np.array_equal(plain.pose, other.pose)
    assert np.array_equal(plain.internal_force, other.internal_force)


@pytest.mark.parametrize("path", ["controller.model.linear_density_factor", "controller.model.length_factor"])
def test_a_wrong_belief_reaches_the_inputs(path: str):
    """Density and length enter Eq. (25) through m, I and hᵀM_q⁻¹h: the first inputs differ already."""
    paper = load_preset("paper")
    plain, other = World(paper).observe(), World(paper.replace({path: 2.0})).observe()
    assert np.abs(other.arm_input - plain.arm_input).max() > 0.5


def test_a_wrong_stiffness_changes_the_believed_plant_and_not_the_papers_law():
    """A beam believed to be half as stiff has the model of one that is; the paper's law does not use the stiffness."""
    stiff = load_preset("paper").replace({"payload.bending_stiffness": 200.0, "controller.model.stiffness_factor": 0.5})
    for believed, true in zip(
        believed_plant(stiff, 3, (0.1,)), believed_plant(load_preset("paper"), 3, (0.1,)), strict=True
    ):
        np.testing.assert_array_equal(believed, true)
    paper = load_preset("paper")
    plain, other = World(paper), World(paper.replace({"controller.model.stiffness_factor": 0.5}))
    assert plain.observe_rows().tobytes() == other.observe_rows().tobytes()


def test_tracking_survives_a_payload_of_twice_the_believed_mass():
    """The purpose of the adaptive law: with half the true density believed, the error is below 1 mm after a second."""
    wrong = load_preset("paper").replace({"controller.model.linear_density_factor": 0.5})
    run = simulate(wrong, 2.0)
    assert np.abs(run.tracking_error[1000:, :2]).max() < 1e-3
