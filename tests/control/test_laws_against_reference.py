"""Every law, continuous and sampled, against an independent integration of arms, beam and law in NumPy and SciPy."""

import numpy as np
import pytest
from reference.control_laws import LAWS, start
from reference.flexible_system import FlexibleSystem
from reference.observed_system import ObservedSystem
from reference.terms import random_scenario

from flexlab.control.law import laws
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.world import World

TOLERANCE = 1e-8
"""Of the final pose, m and rad."""
DURATION = 0.04
"""s: the jerky start, outside and inside the boundary layers."""

GAINS = {
    "adaptive-sliding-mode": {"adaptation": (1e-2, 2e-2, 3e-2), "leakage": 4.0, "boundary_layer": 0.9},
    "vibration-damping": {"lateral_vibration_gain": 50.0, "angular_vibration_gain": 400.0},
    "sliding-mode": {"feedback_gain": (150.0, 200.0, 40.0), "bound": 20.0, "boundary_layer": 0.9},
    "super-twisting": {
        "proportional_gain": (60.0, 80.0, 20.0),
        "integral_gain": (300.0, 200.0, 100.0),
        "boundary_layer": 0.9,
    },
    "disturbance-observer": {"feedback_gain": (150.0, 200.0, 40.0), "observer_gain": 30.0},
    "regressor-adaptive": {"adaptation_gain_mass": 0.3, "adaptation_gain_inertia": 0.004},
    "joint-pd": {"position_gain": (6000.0, 5000.0, 900.0)},
}


OBSERVED = ("composite", "lqr")
"""Laws with an observer, for which `reference.observed_system` is the reference."""


def scenario_of(kind: str, **changes) -> Scenario:
    """Two different arms, gravity, a soft beam, a wrong belief, unequal shares and a squeeze."""
    gains = {f"controller.{name}": value for name, value in GAINS.get(kind, {}).items()}
    common = {
        "controller.kind": kind,
        "controller.load_share": 0.6,
        "controller.wanted_internal_force": 15.0,
        "controller.model.linear_density_factor": 1.2,
        "payload.bending_stiffness": 20.0,
        "trajectory.frequency": (1.0, 1.5, 0.7),
        "trajectory.amplitude": (0.1, 0.1, 0.1),
        "simulation.accuracy": 1e-12,
    }
    return random_scenario(3).replace(common | gains | changes)


def difference(scenario: Scenario, duration: float = DURATION) -> tuple[float, World]:
    """Largest difference of the final pose from the reference, m or rad, and the world."""
    world = World(scenario)
    world.advance(round(duration / world.tick_period))
    assert world.status == "running", world.status.text
    system = FlexibleSystem(scenario, LAWS[scenario.controller.kind], start)
    return float(np.abs(world.observe().pose[0] - system.run(duration)[:3]).max()), world


def test_every_law_has_its_reference():
    own = {kind for kind, law in laws().items() if law.model.__module__.startswith("flexlab.control.laws.")}
    assert own == {*LAWS, *OBSERVED}, "whatever laws other tests have added"


@pytest.mark.parametrize("kind", [kind for kind in LAWS if kind != "none"])
def test_continuous_laws_agree_with_the_reference(kind: str):
    assert difference(scenario_of(kind))[0] < TOLERANCE


@pytest.mark.parametrize("kind", [kind for kind in LAWS if kind != "none"])
def test_sampled_laws_with_a_delay_agree_with_the_reference(kind: str):
    changes = {"controller.control_period": 0.002, "controller.input_delay": 1}
    assert difference(scenario_of(kind, **changes))[0] < TOLERANCE


@pytest.mark.parametrize("kind", ["regressor-adaptive", "joint-pd", "disturbance-observer"])
def test_laws_on_one_arm_agree_with_the_reference(kind: str):
    changes = {"controller.kind": kind, "gravity": 9.81, "simulation.accuracy": 1e-12}
    assert difference(load_preset("single-arm").replace(changes), 0.05)[0] < TOLERANCE


OBSERVER = {
    "controller.observer.kind": "kalman",
    "controller.observer.observer_modes": 2,
    "controller.control_period": 0.002,
}


@pytest.mark.parametrize(
    ("delay", "horizon"), [(0, None), (1, None), (3, None), (2, 1.3), (1, 0.0), (0, 1.0), (1, 2.4)]
)
@pytest.mark.parametrize("kind", OBSERVED)
def test_sampled_laws_with_an_observer_agree_with_the_reference(kind: str, delay: int, horizon: float | None):
    changes = {**OBSERVER, "controller.input_delay": delay, "controller.observer.horizon": horizon}
    if kind == "composite":
        changes |= {"controller.slow.kind": "sliding-mode", "controller.slow.boundary_layer": 0.9}
        changes |= {"controller.lateral_vibration_gain": 40.0, "controller.angular_vibration_gain": 300.0}
    scenario = scenario_of(kind, **changes)
    world = World(scenario)
    world.advance(round(DURATION / world.tick_period))
    assert world.status == "running", world.status.text
    expected = ObservedSystem(scenario).run(DURATION)[:3]
    assert np.abs(world.observe().pose[0] - expected).max() < TOLERANCE
