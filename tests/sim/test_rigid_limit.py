"""A beam that hardly bends behaves as a rigid bar."""

import numpy as np
import pytest
from reference.rigid_system import RigidRun, RigidSystem

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

DURATION = 500
"""Number of samples, one per ms: the whole start-up, until the law has entered its boundary layer."""


def flexible(stiffness: float, **changes) -> tuple[Scenario, Samples]:
    scenario = load_preset("paper").replace({"payload.bending_stiffness": stiffness} | changes)
    world = World(scenario)
    samples = world.run(DURATION)
    assert world.status == "running", world.status.text
    return scenario, samples


@pytest.fixture(scope="module")
def rigid() -> RigidRun:
    """The paper's arms with a rigid bar, by Pinocchio and SciPy."""
    scenario = load_preset("paper")
    return RigidSystem(scenario, build_beam(scenario.payload).kappa).run(np.arange(DURATION + 1) * 0.001)


@pytest.mark.parametrize("stiffness", [1e8, 1e10])
def test_a_stiff_beam_equals_the_rigid_two_arm_system(rigid: RigidRun, stiffness: float):
    """For large EI the pose is within 5e-9 of an independent rigid integration, jerk included; the ring falls as 1/√EI."""
    _, samples = flexible(stiffness)
    assert np.abs(samples.pose - rigid.pose).max() < 5e-9
    assert np.abs(samples.bound_estimates - rigid.bound_estimates).max() < 5e-9
    ring = np.abs(samples.pose_rate[50:] - rigid.pose_rate[50:]).max()
    assert ring < 3e-3 * np.sqrt(1e3 / stiffness)


def test_the_difference_shrinks_as_the_beam_stiffens(rigid: RigidRun):
    """The pose comes closer to the rigid one in proportion to 1/EI, as the static deflection does."""
    gaps = [np.abs(flexible(EI)[1].pose - rigid.pose).max() for EI in (1e3, 1e4, 1e5)]
    ratios = np.array(gaps[:-1]) / np.array(gaps[1:])
    assert np.all((ratios > 5) & (ratios < 20)), ratios
