"""Every stored case against the engine: boundaries, damping kinds, arms, gravity, laws, one arm, start states."""

import numpy as np
import pytest
from reference.solutions import CASES, SAMPLE_PERIOD, Solution

from flexlab.sim.samples import Samples
from flexlab.sim.world import World


@pytest.fixture(scope="module", params=CASES, ids=lambda case: case.name)
def compared(request) -> tuple[Solution, Samples]:
    """A case and the engine's run of it, with the automatic integrator and step."""
    case: Solution = request.param
    world = World(case.scenario, SAMPLE_PERIOD)
    samples = world.run(int(case.rows[-1]))
    assert world.status == "running", world.status.text
    return case, samples


@pytest.mark.parametrize("signal", ["pose", "beam_coordinates", "bound_estimates", "joint_angle"])
def test_configurations_agree_with_the_reference(compared: tuple[Solution, Samples], signal: str):
    """Pose, beam coordinates, bound estimates and joint angles agree within 1e-6."""
    case, samples = compared
    assert case.difference(samples, signal) < 1e-6


@pytest.mark.parametrize(
    ("signal", "relative"),
    [
        ("pose_rate", 1e-5),
        ("beam_rates", 1e-4),
        ("pose_acceleration", 1e-4),
        ("arm_input", 1e-5),
        ("joint_torque", 1e-5),
    ],
)
def test_rates_and_forces_agree_with_the_reference(compared: tuple[Solution, Samples], signal: str, relative: float):
    """Rates, accelerations and inputs agree relative to their largest value: beam rates are q times frequencies of 10² to 10⁴."""
    case, samples = compared
    scale = max(1.0, float(np.abs(case.signals[signal]).max()))
    assert case.difference(samples, signal) < relative * scale


def test_internal_forces_agree_with_the_reference(compared: tuple[Solution, Samples]):
    """They agree within 1e-3 N and N·m."""
    case, samples = compared
    assert case.difference(samples, "internal_force") < 1e-3
