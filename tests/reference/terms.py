"""The engine's own M̄_i, C̄_i, Ḡ_i, 𝒥_i at any pose and rate, and random scenarios and states to test them."""

import numpy as np

from flexlab.physics.arm import ArmTerms, arm_velocity_terms
from flexlab.physics.dynamics import configure_arms
from flexlab.physics.plant import Plant, make_workspace
from flexlab.scenario import Scenario, parse_scenario
from flexlab.sim.build import build_beam, build_plant
from flexlab.sim.termination import pose_fault


def plant_of(scenario: Scenario) -> Plant:
    """Constants of the scenario's plant."""
    return build_plant(scenario, build_beam(scenario.payload))


def arm_terms(plant: Plant, pose: np.ndarray, rate: np.ndarray) -> ArmTerms:
    """𝒥, M̄, C̄ and Ḡ of all arms."""
    workspace = make_workspace(len(plant.arms), plant.modal.shape[1])
    terms = workspace.arm
    assert configure_arms(plant, np.asarray(pose, float), terms, workspace.fault) == 0
    c, s = terms.trig
    for i in range(len(plant.arms)):
        arm_velocity_terms(plant.arms[i], c, s, *map(float, rate), terms.J[i], terms.direction[i], terms.C[i])
    return terms


def random_scenario(seed: int, **changes) -> Scenario:
    """A scenario with gravity and two different arms with random data, both of which reach the poses near (0, 0.8, 0)."""
    rng = np.random.default_rng(seed)

    def arm(side: int) -> dict:
        length = rng.uniform([0.7, 0.6, 0.1], [0.9, 0.8, 0.3])
        return {
            "base": [side * rng.uniform(0.4, 0.6), rng.uniform(-0.1, 0.1)],
            "link_mass": rng.uniform(0.5, 10, 3).tolist(),
            "link_length": length.tolist(),
            "link_center": (length * rng.uniform(-0.2, 1.1, 3)).tolist(),
            "link_inertia": rng.uniform(0.01, 0.5, 3).tolist(),
            "elbow": int(rng.choice([-1, 1])),
        }

    data = {"left_arm": arm(-1), "right_arm": arm(1), "gravity": 9.81, "trajectory": {"center": [0, 0.8, 0]}}
    return parse_scenario(data).replace(changes)


def random_state(scenario: Scenario, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Pose and pose rate of a random state that all arms can reach."""
    while True:
        pose = np.array([0.0, 0.8, 0.0]) + rng.uniform(-1, 1, 3) * [0.2, 0.2, 0.5]
        if pose_fault(scenario, pose, 0.0, "a random pose") is None:
            return pose, rng.normal(size=3)
