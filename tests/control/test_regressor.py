"""Columns of the regressor against finite differences of the Lagrangian arm model."""

import numpy as np
import pytest
from reference.lagrangian import STEP, Lagrangian
from reference.terms import random_scenario, random_state

from flexlab.control.laws.regressor_adaptive import LINKS, PAYLOAD, regressor_adaptive
from flexlab.scenario import Scenario
from flexlab.sim.motion import law_start
from flexlab.sim.world import World

SPAN = 4e-3
"""Step of the differences, m and rad."""
WEIGHTS = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
"""Central differences of order 8."""


def inertia(scenario: Scenario, index: int, link: int, x: np.ndarray) -> np.ndarray:
    """M (3, 3) of one link with 1 kg and its own radius of gyration, by its exact velocities under unit pose rates."""
    arm, model = scenario.arms[index], Lagrangian(scenario, [0, 2 * scenario.payload.element_count])
    gyration = arm.inertia[link] / arm.link_mass[link]

    def moved(v: np.ndarray) -> np.ndarray:
        centers, units = model.links(x + 1j * STEP * v, index)
        unit = units[link]
        turn = (unit[0].real * unit[1].imag - unit[1].real * unit[0].imag) / STEP
        return np.array([*centers[:, link].imag / STEP, np.sqrt(gyration) * turn])

    J = np.array([moved(v) for v in np.eye(3)])
    return J @ J.T


def column(scenario: Scenario, index: int, link: int, x, v, r, r_dot) -> np.ndarray:
    """M ṙ + C r + G of one link with 1 kg, C by Christoffel's formula from differences of M."""
    gradient, slope = np.zeros((3, 3, 3)), np.zeros(3)
    model = Lagrangian(scenario, [0, 2 * scenario.payload.element_count])
    for k, unit in enumerate(np.eye(3)):
        for step, weight in WEIGHTS.items():
            near = [x + sign * step * SPAN * unit for sign in (1, -1)]
            M = [inertia(scenario, index, link, each) for each in near]
            height = [model.links(each, index)[0][1, link] for each in near]
            gradient[k] += weight * (M[0] - M[1]) / SPAN
            slope[k] += weight * (height[0] - height[1]) / SPAN
    C = 0.5 * (
        np.einsum("kij,k->ij", gradient, v) + np.einsum("jik,k->ij", gradient, v) - np.einsum("ijk,k->ij", gradient, v)
    )
    return inertia(scenario, index, link, x) @ r_dot + C @ r + scenario.gravity * slope


@pytest.mark.parametrize("seed", [2, 3])
def test_columns_are_those_of_the_lagrangian(seed: int):
    """What one kilogram in a link contributes to u_i and to dâ/dt, to 1e-10 of the largest entry."""
    changes = {"controller.kind": "regressor-adaptive", "controller.feedback_gain": 0.0, "gravity": 9.81}
    base = random_scenario(seed).replace(changes)
    pose, rate = random_state(base, np.random.default_rng(seed))
    scenario = base.replace({"initial.pose": tuple(pose), "initial.pose_rate": tuple(rate)})
    world = World(scenario)
    begin = law_start(scenario, world.system, 0.0, world.state().y, world._motion.workspace, True)
    assert begin is not None
    now, gains, size = begin.now, begin.gains, PAYLOAD + 2 * LINKS
    slope, (x_d, v_d, a_d) = scenario.controller.sliding_slope, now.desired
    r, r_dot = v_d - slope * (pose - x_d), a_d - slope * (rate - v_d)
    s, law = rate - r, scenario.controller
    for k in range(PAYLOAD, size):
        index, link = divmod(k - PAYLOAD, LINKS)
        memory_rate = np.zeros(size)
        regressor_adaptive.py_func(gains, now, np.eye(size)[k], memory_rate, np.zeros(size))
        expected = column(scenario, index, link, pose, rate, r, r_dot)
        tolerance = 1e-10 * np.abs(expected).max()
        np.testing.assert_allclose(now.u[index], expected, rtol=0, atol=tolerance)
        np.testing.assert_allclose(now.u[1 - index], 0, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            memory_rate[k],
            -law.adaptation_gain_links * (expected @ s),
            rtol=0,
            atol=law.adaptation_gain_links * tolerance * 9,
        )


def test_with_true_estimates_an_almost_rigid_payload_is_followed():
    """With â = a and a start on the path, the error is due to the beam's bending alone, and under 20 µm."""
    changes = {
        "controller.kind": "regressor-adaptive",
        "controller.initial_estimate_factor": 1.0,
        "payload.bending_stiffness": 1e5,
        "initial.pose_rate": None,
        "gravity": 9.81,
    }
    run = World(random_scenario(3).replace(changes)).run(300)
    assert np.abs(run.tracking_error).max() < 2e-5
