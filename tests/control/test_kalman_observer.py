"""The Kalman observer: its model matches the engine, its gain solves the Riccati equation, its estimates follow the beam."""

from dataclasses import replace

import numpy as np
import pytest

from flexlab.analysis.linearization import first_order
from flexlab.analysis.modes import linearize_at, modes
from flexlab.analysis.stability import NEUTRAL, loop_map
from flexlab.control.law import law_of
from flexlab.control.observers.believed_plant import believed_plant, hold
from flexlab.physics.plant import ETA
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.closed_loop import memory_slice
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

HELD = {"trajectory.amplitude": (0.0, 0.0, 0.0)}


def estimated(delay: int = 1, **changes) -> Scenario:
    """A composite law with a Kalman observer at 1 kHz that holds the pose of a beam of eight undamped elements."""
    fixed = {"payload.element_count": 8, "payload.damping.kind": "modal", "payload.damping.ratio": 0.0, **HELD}
    law = {"controller.kind": "composite", "controller.control_period": 1e-3, "controller.input_delay": delay}
    return load_preset("paper").replace({**fixed, **law, "controller.observer.kind": "kalman", **changes})


def test_the_believed_plant_equals_the_engines_linearization():
    """M and the state matrix against differences of the kernels: all modes, away from the symmetric pose."""
    scenario = estimated(
        **{"payload.element_count": 3, "payload.damping.ratio": 0.02, "trajectory.center": (0.1, 0.7, 0.2)}
    )
    engine = linearize_at(scenario, np.array(scenario.trajectory.middle)).plant
    believed = believed_plant(scenario, 6, (0.1,))
    np.testing.assert_allclose(believed.mass, engine.mass, rtol=0, atol=1e-12)
    np.testing.assert_allclose(believed.state_matrix, first_order(engine)[0], rtol=0, atol=1e-8)


def test_the_gain_is_the_limit_of_the_filters_covariance_recursion():
    """From an arbitrary covariance, the recursion leads to the gain in use, and the estimation error then decays."""
    noise = {"controller.sensor_noise.strain": 1e-6, "controller.sensor_noise.pose": (1e-5, 2e-5, 3e-5)}
    scenario = estimated(**noise, **{"payload.damping.ratio": 0.01})
    law = law_of(scenario.controller)
    gains = law.gains(scenario).view(law.gains_type)[0]
    plant, size = believed_plant(scenario, 3, scenario.controller.observer.gauges), 12
    transition, inputs = hold(plant.state_matrix, plant.input_matrix, 1e-3)
    C = np.zeros((10, size))
    C[:3, :3] = C[3:6, 6:9] = np.eye(3)
    C[6:, 3:6] = plant.strain
    R = np.diag(np.array([1e-5, 2e-5, 3e-5, 1e-4, 1e-4, 1e-4, 1e-6, 1e-6, 1e-6, 1e-6]) ** 2)
    Q = inputs @ np.diag(np.array([20, 20, 2, 0.1, 0.1, 0.1]) ** 2) @ inputs.T
    P = 1e-4 * np.eye(size)
    for _ in range(20000):
        L = np.linalg.solve(C @ P @ C.T + R, C @ P).T
        P = transition @ (P - L @ C @ P) @ transition.T + Q
        P = (P + P.T) / 2
    np.testing.assert_allclose(gains["observer_gain"][:size, :10], L, rtol=0, atol=1e-6 * np.abs(L).max())
    assert np.abs(np.linalg.eigvals(transition - L @ C @ transition)).max() < 1


@pytest.mark.parametrize(
    ("delay", "gravity", "period"), [(0, 0.0, 1e-3), (1, 0.0, 1e-3), (3, 9.81, 1e-3), (2, 0.0, 4e-3)]
)
def test_the_linear_map_of_one_control_period_matches_the_simulation(delay: int, gravity: float, period: float):
    """Eigenvalues of one simulated period, by differences in plant, estimate and torques, are those of `loop_map`."""
    smooth = {"controller.slow.kind": "pd", "gravity": gravity, "trajectory.center": (0.05, 0.72, 0.1)}
    tight = {"controller.control_period": period, "payload.element_count": 2, "simulation.step": period / 400}
    scenario = estimated(delay, **smooth, **tight, **{"payload.damping.ratio": 0.01})
    found = modes(scenario)
    linear = found.linearization
    assert linear is not None
    rest, n = linear.rest, len(linear.rest.motion.eta)
    assert not rest.drifting
    world = World(scenario.replace({"initial.pose": tuple(rest.motion.x)}), period)
    state, memory = world.state(), memory_slice(world.system)
    y = state.y.copy()
    y[ETA : ETA + n], y[memory] = rest.motion.eta, rest.memory
    line = np.broadcast_to(rest.torque.reshape(-1, 3), state.torque_line.shape).copy()
    index = np.r_[0:6, ETA : ETA + 2 * n, memory.start + 3 : memory.stop - 1]
    size = np.repeat([1e-6, 1e-4, 1e-6, 1e-4, 1e-5], [3, 3, n, n, 12])

    def advanced(step: np.ndarray) -> np.ndarray:
        moved, torques = y.copy(), line + 1e-2 * step[len(index) :].reshape(line.shape)
        moved[index] += size * step[: len(index)]
        world.restore(replace(state, y=moved, torque_line=torques, held_torque=torques[0].copy()))
        world.advance(1)
        after = world.state()
        return np.concatenate([after.y[index] / size, after.torque_line.ravel() / 1e-2])

    unit = np.eye(len(index) + line.size)
    assert np.abs(advanced(np.zeros(len(unit)))[: len(index)] * size - y[index]).max() < 1e-8
    simulated = np.linalg.eigvals(np.stack([(advanced(e) - advanced(-e)) / 2 for e in unit], axis=1))
    own = np.linalg.eigvals(loop_map(linear))
    for z in own[np.abs(own) > 0.1]:
        assert np.abs(simulated - z).min() < 1e-5
    for z in simulated[np.abs(simulated) > 0.1]:
        assert np.abs(own - z).min() < 1e-5


def test_with_a_delay_only_prediction_keeps_the_third_mode_from_growing():
    """With measured rates or without prediction, 401 Hz grows at 2.65 1/s; with prediction nothing grows so fast."""
    measured = modes(estimated(**{"controller.observer.kind": "measured"}))
    late = modes(estimated(**{"controller.observer.horizon": 0.0}))
    for found in (measured, late):
        row = found.pole_rows()[0]
        assert row.frequency == pytest.approx(401, abs=1)
        assert row.rate == pytest.approx(2.65, abs=0.01)
    assert modes(estimated()).growth < 0.25
    assert modes(estimated(**{"payload.damping.ratio": 1e-3})).growth < 0


@pytest.mark.parametrize("kept", [3, 4, 6, 16])
def test_spillover_grows_at_the_rate_of_the_poles(kept: int):
    """Three modes of a plant with 3 to 16 are estimated: the energy of the run grows or decays at the pole's rate.

    The undamped fifth mode (1122 Hz, aliased to 122 Hz by the 1 kHz clock) is fed because the gauges mistake it for another.
    """
    scenario = estimated(**{"payload.mode_count": kept})
    found = modes(scenario)
    row = found.pole_rows()[0]
    assert (row.origin == "beam mode 5") == (kept > 4)
    assert found.growth == pytest.approx(0.227 if kept > 4 else 0.045, abs=0.002)
    mode = 4 if kept > 4 else 1
    start = 1e-6 * found.shape[:, mode]
    run = simulate(scenario.replace({"initial.beam_coordinates": tuple(start)}), 4.0)
    energy = run.kinetic_energy + run.elastic_energy
    later = run.time > 2.0
    growth = np.polyfit(run.time[later], np.log(energy[later]), 1)[0] / 2
    assert growth == pytest.approx(found.growth, rel=0.03)
    assert found.unstable == (found.growth > NEUTRAL)


def test_the_estimated_modes_follow_the_true_ones():
    """On a moving, ringing beam without noise, all four are estimated to 2 %, though the model is that of one pose."""
    law = {"controller.kind": "composite", "controller.control_period": 1e-3, "controller.input_delay": 1}
    own = {"controller.observer.kind": "kalman", "controller.observer.observer_modes": 4}
    world = World(load_preset("paper").replace({**law, **own, "controller.lateral_vibration_gain": 5.0}), 1e-3)
    n, memory = 4, memory_slice(world.system)
    rank = np.argsort(world.beam.modes.omega)
    world.advance(20)
    pairs = []
    for _ in range(400):
        world.advance(1)
        y = world.state().y
        pairs.append((y[memory][6 : 6 + n], y[ETA : ETA + n][rank]))
    estimate, truth = np.moveaxis(np.array(pairs), 1, 0)
    error = np.abs(estimate - truth).max(axis=0) / np.abs(truth).max(axis=0)
    assert np.all(error < 0.02), error
