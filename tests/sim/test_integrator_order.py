"""Observed order of each integrator: how fast the error against a much finer run falls when the step is halved."""

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.integrators.scheme import ORDER
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

TICK = 0.002
"""Sample period, s: a multiple of every step below."""
SIGNALS = ("pose", "beam_coordinates", "pose_rate", "bound_estimates")

STEPS = {
    "rk4": (4e-4, 2e-4, 1e-4, 5e-5),
    "etdrk4": (1e-3, 5e-4, 2.5e-4, 1.25e-4),
    "generalized-alpha": (5e-4, 2.5e-4, 1.25e-4, 6.25e-5),
}
"""Steps, s, each half of the one before."""


def sample(scenario: Scenario, integrator: str, step: float) -> Samples:
    """A run of 0.2 s with a given step."""
    changes = {"simulation.integrator": integrator, "simulation.step": step}
    world = World(scenario.replace(changes), TICK)
    assert world.step == pytest.approx(step)
    samples = world.run(100)
    assert world.status == "running", world.status.text
    return samples


def slopes(scenario: Scenario, integrator: str, reference_step: float) -> dict[str, np.ndarray]:
    """Observed orders: log2 of the ratio of errors, for each halving of the step and each signal."""
    exact = sample(scenario, "etdrk4", reference_step)
    runs = [sample(scenario, integrator, step) for step in STEPS[integrator]]
    errors = {name: [np.abs(getattr(run, name) - getattr(exact, name)).max() for run in runs] for name in SIGNALS}
    return {name: -np.diff(np.log2(values)) for name, values in errors.items()}


RINGING = {"controller.boundary_layer": 10.0, "payload.bending_stiffness": 10.0}
"""The paper's jerk on a beam whose four modes (14 to 286 Hz) all steps resolve. The motion stays inside the boundary layer: the
law has a kink at its edge, where any method falls to low order."""

SCENARIOS = {
    "ringing": RINGING,
    "heavy payload, stiffness damping": RINGING
    | {"payload.linear_density": 40.0, "payload.damping": {"kind": "stiffness", "coefficient": 1e-3}},
}


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("integrator", STEPS)
def test_observed_order_is_the_declared_one(integrator: str, name: str):
    """Order 4 for rk4 and etdrk4, 2 for generalized-alpha, in all signals, beam and controller memory included."""
    assert {"rk4": 4, "etdrk4": 4, "generalized-alpha": 2} == ORDER
    found = slopes(load_preset("paper").replace(SCENARIOS[name]), integrator, TICK / 256)
    for signal, values in found.items():
        assert np.all(np.abs(values - ORDER[integrator]) < 0.25), (signal, values)


def test_pose_converges_with_order_four_from_a_smooth_start():
    """A start on the trajectory excites almost no vibration and never leaves the boundary layer."""
    changes = {"initial.pose_rate": None, "payload.bending_stiffness": 10.0}
    found = slopes(load_preset("paper").replace(changes), "etdrk4", TICK / 256)
    for signal in ("pose", "beam_coordinates", "pose_rate"):
        assert np.all(np.abs(found[signal] - 4) < 0.25), (signal, found[signal])


def test_etdrk4_loses_order_where_modes_too_fast_for_its_steps_are_driven():
    """The coupling -h v2 - g ω of stiff modes to the pose is not part of the exact linear flow.

    A jerk excites 32 modes up to 10⁵ rad/s. While Δt ω ≫ 1 for most of them, the coupling is a stiff term that is
    only interpolated over the step, and the order falls to between 2 and 3.5. The method stays convergent and accurate.
    """
    changes = {"controller.boundary_layer": 10.0, "payload.element_count": 16}
    found = slopes(load_preset("paper").replace(changes), "etdrk4", TICK / 512)
    assert np.all(found["pose"] > 1.9)
    assert found["pose"].mean() < 3.5


@pytest.mark.parametrize("jumps", [{"trajectory.kind": "bang-bang"}, {"controller.control_period": 1e-3}])
@pytest.mark.parametrize("integrator", STEPS)
def test_a_jump_of_the_acceleration_on_a_step_costs_no_order(integrator: str, jumps: dict[str, object]) -> None:
    """A step must not see past a jump at its end, nor generalized-alpha go on with the accelerations from before one.

    Halving the steps would only halve the error.
    """
    scenario = load_preset("soft-beam").replace({**jumps, "simulation.integrator": integrator})
    coarse, fine, finest = (
        simulate(scenario.replace({"simulation.step": step}), 0.6).internal_force for step in (2e-4, 1e-4, 2.5e-5)
    )
    errors = [np.abs(force - finest).max() for force in (coarse, fine)]
    first, share = (1e-4, 8) if ORDER[integrator] == 4 else (2e-4, 3.5)
    assert errors[0] < first * np.abs(finest).max()
    assert errors[1] < errors[0] / share
