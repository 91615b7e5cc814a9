"""The linear-quadratic regulator: optimal on its own model, stable on more modes than it knows."""

import re

import numpy as np
import pytest

from flexlab.analysis.modes import modes
from flexlab.control.laws.lqr import regulator_gain
from flexlab.control.motion import poses
from flexlab.control.observers.believed_plant import believed_plant, hold
from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World


def regulated(delay: int = 1, **changes) -> Scenario:
    """The paper's scenario under LQR at 1 kHz, with eight elements and hardly any damping."""
    beam = {"payload.element_count": 8, "payload.damping.kind": "modal", "payload.damping.ratio": 1e-3}
    clock = {"controller.kind": "lqr", "controller.control_period": 1e-3, "controller.input_delay": delay}
    return load_preset("paper").replace({**beam, **clock, **changes})


def test_its_gain_has_the_least_cost_on_its_own_model():
    """From a random start, the sum of zᵀQz + FᵀRF is larger for gains nearby, by a term of second order."""
    scenario = regulated()
    law, K = scenario.controller, regulator_gain(scenario)
    plant = believed_plant(scenario, 3, law.observer.gauges)
    A, B = hold(plant.state_matrix, plant.input_matrix[:, :3], 1e-3)
    beam = np.full(3, law.vibration_weight)
    Q = np.diag([*law.pose_weight, *(beam * plant.omega**2), *law.pose_rate_weight, *beam])
    rng = np.random.default_rng(5)
    start = rng.normal(size=12) / np.sqrt(np.diag(Q))

    def cost(gain: np.ndarray) -> float:
        z, total = start, 0.0
        for _ in range(6000):
            force = -gain @ z
            total += z @ Q @ z + force @ (law.force_weight * force)
            z = A @ z + B @ force
        return float(total)

    best = cost(K)
    assert np.abs(np.linalg.eigvals(A - B @ K)).max() < 1
    for _ in range(4):
        other = 1e-3 * np.abs(K) * rng.normal(size=K.shape)
        slope = (cost(K + other) - cost(K - other)) / 2
        assert cost(K + other) > best
        assert abs(slope) < 1e-3 * best


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_it_is_stable_on_sixteen_modes_of_which_it_knows_three(delay: int):
    held = regulated(delay, **{"trajectory.amplitude": (0.0, 0.0, 0.0)})
    assert modes(held).growth < 0
    moved = held.replace({"initial.pose": (0.01, 0.74, 0.02)})
    run = simulate(moved, 1.5)
    assert run.status == "finished"
    assert np.abs(run.tracking_error[-1]).max() < 1e-4
    assert np.abs(run.vibration[-200:]).max() < 1e-2 * np.abs(run.vibration).max()


def test_it_needs_a_control_period():
    sentence = "the law lqr acts at control instants: give the control period (controller.control_period) a value in s"
    with pytest.raises(ScenarioError, match=re.escape(sentence)):
        load_preset("paper").replace({"controller.kind": "lqr"})


def test_it_takes_the_estimate_over_from_a_composite_law():
    composite = {"controller.kind": "composite", "controller.observer.kind": "kalman"}
    world = World(regulated().replace(composite))
    world.advance(100)
    known = world.state().y.copy()
    world.apply(ChangeScenario({"controller.kind": "lqr"}))
    after = world.state().y
    assert any(np.array_equal(after[k : k + 13], known[-13:]) for k in range(len(after) - 12))
    assert len(world.advance(50)) == 50


@pytest.mark.parametrize("delay", [0, 2])
def test_its_target_is_the_path_at_the_time_its_torques_act(delay: int):
    world = World(regulated(delay, **{"controller.control_period": 5e-3}))
    world.advance(25)
    coming = poses(world.system.trajectory, [0.025 + delay * 5e-3])[0]
    assert np.allclose(world._motion.workspace.measured[0].coming, coming, rtol=1e-12, atol=1e-12)
