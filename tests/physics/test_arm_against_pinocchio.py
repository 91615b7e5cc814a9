"""Arms in task space against Pinocchio, which models them as joints, links and frames."""

import numpy as np
import pinocchio as pin
import pytest
from reference.pinocchio_arms import pinocchio_arms
from reference.terms import arm_terms, plant_of, random_scenario, random_state

from flexlab.scenario import Scenario
from flexlab.sim.world import World

RELATIVE = 1e-10


def scaled_difference(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(found - expected).max() / max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("seed", range(12))
def test_inertia_velocity_matrix_and_weight_agree_with_pinocchio(seed: int):
    """M̄_i, C̄_i, Ḡ_i of random arms at random states agree to 1e-10 with Pinocchio's M, C, G transformed to task space."""
    scenario = random_scenario(seed)
    plant, arms = plant_of(scenario), pinocchio_arms(scenario)
    rng = np.random.default_rng(1000 + seed)
    for _ in range(8):
        pose, rate = random_state(scenario, rng)
        terms = arm_terms(plant, pose, rate)
        for i, arm in enumerate(arms):
            M, C, G = arm.in_task_space(pose, rate)
            assert scaled_difference(terms.M[i], M) < RELATIVE
            assert scaled_difference(terms.C[i], C) < RELATIVE
            assert scaled_difference(terms.G[i], G) < RELATIVE


def test_joint_angles_put_the_grip_where_the_payload_is():
    """Pinocchio's forward kinematics of the sampled joint angles end at (x0, y0) ± ½L e1, with angle θ or θ + π."""
    scenario = Scenario()
    samples = World(scenario).run(200)
    for side, arm, angles in zip(
        (-1, 1), pinocchio_arms(scenario), np.moveaxis(samples.joint_angle, 1, 0), strict=True
    ):
        for pose, angle in zip(samples.pose[::20], angles[::20], strict=True):
            pin.framesForwardKinematics(arm.model, arm.data, angle)
            place = arm.data.oMf[arm.grip]
            axis = np.array([np.cos(pose[2]), np.sin(pose[2])])
            np.testing.assert_allclose(place.translation[:2], pose[:2] + side * 0.25 * axis, rtol=0, atol=1e-12)
            np.testing.assert_allclose(place.rotation[:2, 0], -side * axis, rtol=0, atol=1e-12)


@pytest.mark.parametrize("elbow", [-1, 1])
def test_the_elbow_stands_on_the_side_asked_for(elbow: int):
    """`elbow` is the sign of joint 2."""
    scenario = Scenario().replace({"left_arm.elbow": elbow, "right_arm.elbow": elbow})
    samples = World(scenario).run(100)
    assert np.all(np.sign(samples.joint_angle[:, :, 1]) == elbow)
