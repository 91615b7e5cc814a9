"""Pulls on a link: the spring of a hand acts on a point of an arm."""

import numpy as np
import pytest
from reference.terms import arm_terms

from flexlab.errors import ScenarioError
from flexlab.physics.internal_force import internal_force_by_eq_26
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.build import nodal_damping_matrix
from flexlab.sim.commands import Pull
from flexlab.sim.geometry import arm_points
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

FREE = {"controller.kind": "none", "payload.damping.coefficient": 0.0}
PULLS = [
    Pull(0.5, (-1.2, 0.5), 900.0, (1, 1)),
    Pull(0.25, (-0.9, 0.9), 900.0, (1, 2)),
    Pull(0.15, (0.6, 1.0), 900.0, (2, 3)),
    Pull(0.6, (0.9, 0.3), 900.0, (2, 2)),
]


def held_point(scenario: Scenario, samples: Samples, pull: Pull) -> np.ndarray:
    """The held point by forward kinematics from the joint angles, m, (N, 2)."""
    assert pull.link is not None
    arm, link = pull.link
    points = arm_points(scenario, samples)[:, arm - 1]
    share = pull.position / scenario.arms[arm - 1].link_length[link - 1]
    return points[:, link - 1] + share * (points[:, link] - points[:, link - 1])


def spring_energy(scenario: Scenario, samples: Samples, pull: Pull) -> np.ndarray:
    """½k d², J, (N,)."""
    return pull.stiffness / 2 * np.sum((held_point(scenario, samples, pull) - pull.target) ** 2, axis=1)


@pytest.mark.parametrize("pull", PULLS, ids=str)
def test_the_pulls_work_is_what_its_spring_gives(pull: Pull) -> None:
    """With motors off and no damping, the work done is the energy that the spring gives up and that the machine gains."""
    world = World(load_preset("paper").replace({**FREE, "simulation.step": 5e-5}))
    world.apply(pull)
    samples = world.run(250)
    spring = spring_energy(world.scenario, samples, pull)
    assert spring[0] - spring.min() > 0.05 * spring[0]
    np.testing.assert_allclose(samples.input_work, spring[0] - spring, rtol=0, atol=1e-8 * spring[0])
    gain = samples.total_energy - samples.total_energy[0]
    np.testing.assert_allclose(gain, spring[0] - spring, rtol=0, atol=1e-7 * spring[0])


@pytest.mark.parametrize("pull", PULLS, ids=str)
def test_every_integrator_feels_the_same_pull(pull: Pull) -> None:
    """Momentum form (rk4, etdrk4) and acceleration form (generalized-alpha) agree on the next 20 ms."""
    runs = []
    for integrator in ("rk4", "etdrk4", "generalized-alpha"):
        changes = {**FREE, "simulation.integrator": integrator, "simulation.step": 1e-5}
        world = World(load_preset("paper").replace(changes))
        world.apply(pull)
        runs.append(world.run(20))
    assert np.abs(runs[0].pose_rate[-1] - runs[0].pose_rate[0]).max() > 0.01
    for other in runs[1:]:
        np.testing.assert_allclose(other.pose, runs[0].pose, rtol=0, atol=5e-7)


@pytest.mark.parametrize("pull", PULLS, ids=str)
def test_internal_force_counts_the_pull_as_an_input_of_the_arm(pull: Pull) -> None:
    """Eq. (26) with u_i + Q gives the sampled internal force, Q = -∂(½k d²)/∂x by differences of the kinematics."""
    world = World(load_preset("paper"))
    world.advance(37)
    world.apply(pull)
    sample = world.observe()
    arm = pull.link[0] - 1 if pull.link else 0
    h, force = 1e-6, np.zeros(3)
    for axis in range(3):
        ends = []
        for sign in (1, -1):
            pose = sample.pose[0] + sign * h * np.eye(3)[axis]
            moved = World(world.scenario.replace({"initial.pose": tuple(pose)}))
            ends.append(float(spring_energy(world.scenario, moved.observe(), pull)[0]))
        force[axis] = -(ends[0] - ends[1]) / (2 * h)
    u = sample.arm_input[0].copy()
    u[arm] += force
    terms = arm_terms(world.system.plant, sample.pose[0], sample.pose_rate[0])
    expected = internal_force_by_eq_26(
        world.beam.matrices,
        nodal_damping_matrix(world.beam),
        terms.M,
        terms.C,
        terms.G,
        u,
        sample.pose[0],
        sample.pose_rate[0],
        sample.beam_coordinates[0],
        sample.beam_rates[0],
    )
    assert np.abs(force).max() > 1
    np.testing.assert_allclose(sample.internal_force[0], expected, rtol=0, atol=1e-6 * np.abs(u).max())


def test_letting_go_ends_the_force() -> None:
    world, pull = World(load_preset("paper").replace(FREE)), PULLS[1]
    world.apply(pull)
    world.advance(50)
    pulled = world.observe()
    world.apply(Pull(pull.position, pull.target, 0.0, pull.link))
    free = world.observe()
    assert np.abs(free.pose_acceleration - pulled.pose_acceleration).max() > 0.1
    later = world.advance(50)
    np.testing.assert_allclose(later.input_work, free.input_work[0], rtol=0, atol=1e-12)


def test_the_hand_may_move_from_a_link_to_the_beam() -> None:
    """There is one hand: only what it holds now is pulled, as in a world that was never pulled elsewhere."""
    one, other = (World(load_preset("paper").replace(FREE)) for _ in range(2))
    one.apply(PULLS[0])
    for world in (one, other):
        world.apply(Pull(0.1, (0.2, 0.9), 500.0))
    assert np.array_equal(one.run(30).pose, other.run(30).pose)


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (Pull(0.1, (0.0, 1.0), 10.0, (3, 1)), "choose arm 1 to 2 and link 1 to 3"),
        (Pull(0.1, (0.0, 1.0), 10.0, (1, 0)), "choose arm 1 to 2 and link 1 to 3"),
        (Pull(0.71, (0.0, 1.0), 10.0, (1, 1)), "outside 0 to 0.7 m"),
        (Pull(-0.01, (0.0, 1.0), 10.0, (2, 3)), "outside 0 to 0.2 m"),
        (Pull(float("nan"), (0.0, 1.0), 10.0, (2, 3)), "outside 0 to 0.2 m"),
    ],
    ids=str,
)
def test_senseless_pulls_are_refused(command: Pull, words: str) -> None:
    world = World(load_preset("paper"))
    with pytest.raises(ScenarioError, match=words):
        world.apply(command)
    assert world.state().pull[3] == 0
