"""Arm inputs of five laws against their formulas in NumPy, along runs with gravity, different arms, or one arm."""

import numpy as np
import pytest
from reference.terms import arm_terms, random_scenario

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

LAWS = {
    "adaptive-sliding-mode": {
        "controller.feedback_gain": (150.0, 260.0, 40.0),
        "controller.sliding_slope": (35.0, 60.0, 20.0),
        "controller.adaptation": (1e-3, 2e-3, 3e-3),
    },
    "vibration-damping": {
        "controller.kind": "vibration-damping",
        "controller.lateral_vibration_gain": 80.0,
        "controller.angular_vibration_gain": 500.0,
        "controller.adaptation": (1e-2, 1e-2, 1e-2),
    },
    "computed-torque": {"controller.kind": "computed-torque", "controller.velocity_gain": (80.0, 100.0, 60.0)},
    "pd": {"controller.kind": "pd", "controller.position_gain": (20000.0, 15000.0, 3000.0)},
    "none": {"controller.kind": "none"},
}

SCENARIOS: dict[str, Scenario] = {
    "paper": load_preset("paper"),
    "gravity, odd arms": random_scenario(5),
    "single arm": load_preset("single-arm").replace({"gravity": 9.81}),
    "believes another payload": load_preset("paper").replace(
        {"controller.model.linear_density_factor": 1.7, "controller.model.length_factor": 0.8, "gravity": 3.0}
    ),
}


def believed(scenario: Scenario) -> tuple[float, np.ndarray]:
    """Mass, and A11 - A12 A22⁻¹A21 at q = 0, θ = 0, of the payload that the controller believes in."""
    model, payload = scenario.controller.model, scenario.payload
    other = payload.model_copy(
        update={
            "length": payload.length * model.length_factor,
            "linear_density": payload.linear_density * model.linear_density_factor,
        }
    )
    beam = World(Scenario(payload=other, right_arm=scenario.right_arm)).beam.matrices
    loads = np.stack([beam.h, beam.g])
    kappa = loads @ np.linalg.solve(beam.M_q, loads.T)
    A = np.diag([beam.m, beam.m, beam.I])
    A[1:, 1:] -= kappa
    return beam.m, A


def turned(A: np.ndarray, theta: float) -> np.ndarray:
    """A at the angle θ."""
    c, s = np.cos(theta), np.sin(theta)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return R @ A @ R.T


def law(scenario: Scenario, terms, x, v, desired, b_hat, loads_rate, m, A) -> np.ndarray:
    """u_i (arms, 3), Eq. (25) and its rivals."""
    gains, share = scenario.controller, 1 / len(scenario.arms)
    x_d, v_d, a_d = desired
    e, e_dot = x - x_d, v - v_d
    weight = np.array([0, m * scenario.gravity, 0])
    if gains.kind == "none":
        return np.zeros((len(scenario.arms), 3))
    if gains.kind == "pd":
        feedback = -np.array(gains.position_gain) * e - gains.velocity_gain * e_dot
        return terms.G + share * (weight + feedback)
    if gains.kind == "computed-torque":
        a = a_d - np.array(gains.velocity_gain) * e_dot - gains.position_gain * e
        return (terms.M + share * A) @ a + terms.C @ v + terms.G + share * weight
    slope = np.broadcast_to(gains.sliding_slope, 3)
    r, r_dot = v_d - slope * e, a_d - slope * e_dot
    s = v - r
    bound = b_hat @ [1, np.linalg.norm(x), v @ v]
    u2 = -np.array(gains.feedback_gain) * s
    u3 = -bound * s / max(np.linalg.norm(s), gains.boundary_layer)
    u = (terms.M + share * A) @ r_dot + terms.C @ r + terms.G + share * (u2 + u3 + weight)
    if gains.kind == "vibration-damping":
        lateral, turn = np.array([gains.lateral_vibration_gain, gains.angular_vibration_gain]) * loads_rate
        push = np.array([-np.sin(x[2]) * lateral, np.cos(x[2]) * lateral, turn])
        u = u + share * terms.M.sum(axis=0) @ push
    return u


@pytest.mark.parametrize("base", SCENARIOS)
@pytest.mark.parametrize("kind", LAWS)
def test_arm_inputs_equal_the_formula_of_the_law(kind: str, base: str):
    """u_i sampled over the jerky start, inside and outside the boundary layer, equals the formula to rounding."""
    scenario = SCENARIOS[base].replace(LAWS[kind])
    world = World(scenario)
    samples = world.run(120)
    beam, path = world.beam.matrices, scenario.trajectory
    m, A = believed(scenario)
    rate = 2 * np.pi * np.array(path.frequency)
    for k in range(0, len(samples), 9):
        x, v, q_dot = samples.pose[k], samples.pose_rate[k], samples.beam_rates[k]
        angle = rate * samples.time[k] + path.phase
        size = np.array(path.amplitude)
        desired = (path.center + size * np.sin(angle), size * rate * np.cos(angle), -size * rate**2 * np.sin(angle))
        terms = arm_terms(world.system.plant, x, v)
        loads_rate = np.array([beam.h @ q_dot, beam.g @ q_dot])
        expected = law(scenario, terms, x, v, desired, samples.bound_estimates[k], loads_rate, m, turned(A, x[2]))
        scale = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(samples.arm_input[k], expected, rtol=0, atol=1e-9 * scale)
        np.testing.assert_allclose(samples.desired_pose[k], desired[0], rtol=0, atol=1e-13)
        np.testing.assert_allclose(samples.tracking_error[k], x - desired[0], rtol=0, atol=1e-13)


def test_estimates_grow_by_the_adaptation_law():
    """ḃ0 = ‖s‖/k0, ḃ1 = ‖s‖‖x‖/k1, ḃ2 = ‖s‖‖ẋ‖²/k2 (the paper prints one dot too many), by Simpson's rule."""
    world = World(load_preset("paper").replace({"controller.adaptation": (10.0, 5.0, 2.0)}), 1e-4)
    samples = world.run(1000)
    s = np.linalg.norm(samples.sliding_variable, axis=1)
    x, v = np.linalg.norm(samples.pose, axis=1), np.linalg.norm(samples.pose_rate, axis=1)
    rates = np.stack([s, s * x, s * v**2], axis=1) / [10.0, 5.0, 2.0]
    weights = np.ones(1001)
    weights[1:-1:2], weights[2:-1:2] = 4, 2
    np.testing.assert_allclose(samples.bound_estimates[-1], 1e-4 / 3 * weights @ rates, rtol=1e-7)


def test_sliding_variable_is_the_error_rate_plus_slope_times_error():
    """s = ė + Λe, by differences of the sampled error."""
    samples = World(load_preset("paper"), 1e-4).run(400)
    e = samples.tracking_error
    e_dot = (8 * (e[3:-1] - e[1:-3]) - (e[4:] - e[:-4])) / 12e-4
    np.testing.assert_allclose(samples.sliding_variable[2:-2], e_dot + 50 * e[2:-2], rtol=0, atol=1e-5)


@pytest.mark.parametrize("period", [None, 1e-3])
def test_motors_that_are_off_give_no_torque_whatever_is_fed_forward(period: float | None):
    fed = {"trajectory.bending_feedforward": 1.0, "controller.wanted_internal_force": 20.0}
    known = {"joints.friction.viscous": (5.0, 5.0, 5.0), "controller.model.friction_factor": 1.0}
    off = load_preset("paper").replace({"controller.kind": "none", "initial.pose_rate": None})
    run = simulate(off.replace({**fed, **known, "controller.control_period": period}), 0.05)
    assert not run.joint_torque.any()
    assert np.abs(run.pose_rate[-1] - run.pose_rate[0]).max() > 1e-2
