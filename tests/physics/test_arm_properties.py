"""Properties that the arms' terms have at every state."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference.terms import arm_terms, plant_of, random_scenario, random_state

from flexlab.physics.arm import joint_torques, task_input


@pytest.mark.parametrize("seed", range(8))
def test_inertia_rate_less_twice_the_velocity_matrix_is_skew(seed: int):
    """Property 2: Ṁ_i - 2C̄_i is skew to 1e-10, with Ṁ from Richardson extrapolation of differences along the motion."""
    scenario = random_scenario(seed)
    plant, rng = plant_of(scenario), np.random.default_rng(100 + seed)
    for _ in range(5):
        pose, rate = random_state(scenario, rng)
        rate = 0.3 * rate / np.linalg.norm(rate)

        def slope(h, pose=pose, rate=rate):
            return (arm_terms(plant, pose + h * rate, rate).M - arm_terms(plant, pose - h * rate, rate).M) / (2 * h)

        table = [slope(0.02 / 2**k) for k in range(6)]
        for order in range(1, 6):
            table = [(4**order * fine - rough) / (4**order - 1) for rough, fine in zip(table, table[1:], strict=False)]
        N = table[0] - 2 * arm_terms(plant, pose, rate).C
        assert np.abs(N + np.swapaxes(N, 1, 2)).max() < 1e-10 * max(1.0, np.abs(table[0]).max())


@pytest.mark.parametrize("seed", range(4))
def test_arm_inertia_is_symmetric_and_positive_definite(seed: int):
    """Property 1 of Eq. (16) for M̄_i."""
    scenario = random_scenario(seed)
    plant, rng = plant_of(scenario), np.random.default_rng(seed)
    for _ in range(20):
        pose, rate = random_state(scenario, rng)
        M = arm_terms(plant, pose, rate).M
        np.testing.assert_allclose(M, np.swapaxes(M, 1, 2), rtol=0, atol=1e-12 * np.abs(M).max())
        assert np.linalg.eigvalsh(M).min() > 0


THREE = st.tuples(*[st.floats(-100, 100)] * 3)


@settings(max_examples=60)
@given(seed=st.integers(0, 5), u=THREE, rate=THREE)
def test_joint_torques_do_the_work_of_the_task_input(seed: int, u, rate):
    """u = 𝒥ᵀτ both ways, and τ·θ̇ = u·ẋ: the same power through the joints and through the grip."""
    scenario = random_scenario(seed)
    plant, rng = plant_of(scenario), np.random.default_rng(seed)
    pose, _ = random_state(scenario, rng)
    terms = arm_terms(plant, pose, np.zeros(3))
    c, s = terms.trig
    u, rate = np.array(u), np.array(rate)
    for i in range(2):
        tau, back = np.zeros(3), np.zeros(3)
        joint_torques(plant.arms[i], c, s, terms.direction[i], u, tau)
        task_input(terms.J[i], tau, back)
        size = max(1.0, np.abs(u).max())
        np.testing.assert_allclose(back, u, rtol=0, atol=1e-9 * size)
        absolute = np.array([terms.J[i, 0] @ rate, terms.J[i, 1] @ rate, rate[2]])
        joint_rate = np.array([absolute[0], absolute[1] - absolute[0], absolute[2] - absolute[1]])
        power = size * max(1.0, np.abs(rate).max())
        assert tau @ joint_rate == pytest.approx(u @ rate, abs=1e-9 * power)
