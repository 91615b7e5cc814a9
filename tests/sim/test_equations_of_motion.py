"""The compiled right-hand side against Hamilton's equations of a Lagrangian of moving points.

The Lagrangian (`reference.lagrangian`) knows only the positions of masses; momenta and forces are its derivatives, by
differences. The system has a beam, both arms, gravity, damping and a pull.
"""

from typing import NamedTuple

import numpy as np
import pytest
from reference.lagrangian import Lagrangian, gradient, hermite
from reference.terms import random_scenario, random_state

from flexlab.physics.beam import free_coordinates
from flexlab.physics.dynamics import set_momenta
from flexlab.physics.plant import DISSIPATED, ETA, WORK, P, X, make_workspace
from flexlab.sim.build import nodal_damping_matrix
from flexlab.sim.closed_loop import rates_at
from flexlab.sim.commands import Pull
from flexlab.sim.world import World

PULL_AT, PULL_TO, PULL_STIFFNESS = 0.1, (0.3, 0.9), 800.0


class Derivative(NamedTuple):
    """The kernel's state and its derivative, and the same state in p = (x0, y0, θ, q)."""

    world: World
    lagrangian: Lagrangian
    held: list[int]
    p: np.ndarray
    p_rate: np.ndarray
    y: np.ndarray
    dy: np.ndarray
    """Complete derivative."""
    partial: np.ndarray
    """Derivative without the beam's linear part."""

    def potential_of_pull(self, p: np.ndarray) -> float:
        row = np.delete(hermite(self.lagrangian.scenario.payload, np.array([PULL_AT]))[0], self.held, axis=1)[0]
        c, s, w = np.cos(p[2]), np.sin(p[2]), row @ p[3:]
        x, y = p[0] + PULL_AT * c - w * s, p[1] + PULL_AT * s + w * c
        return PULL_STIFFNESS / 2 * ((PULL_TO[0] - x) ** 2 + (PULL_TO[1] - y) ** 2)


CASES = [(2, "pinned-pinned"), (3, "clamped-pinned"), (4, "clamped-clamped"), (3, "pinned-clamped")]


@pytest.fixture(scope="module", params=[(*case, seed) for seed, case in enumerate(CASES * 2)], ids=str)
def derivative(request) -> Derivative:
    """Both forms of the kernel's derivative at a random state of random arms without control."""
    n, boundary, seed = request.param
    scenario = random_scenario(
        seed,
        **{
            "payload.element_count": n,
            "payload.boundary": boundary,
            "payload.bending_stiffness": 30.0,
            "payload.damping.coefficient": 0.4,
            "controller.kind": "none",
        },
    )
    rng, count = np.random.default_rng(seed), scenario.payload.coordinate_count
    pose, rate = random_state(scenario, rng)
    q, q_dot = 0.05 * rng.normal(size=count), rng.normal(size=count)
    world = World(scenario.replace({"initial.pose": pose, "initial.pose_rate": rate, "initial.beam_coordinates": q}))
    world.apply(Pull(PULL_AT, PULL_TO, PULL_STIFFNESS))
    V = world.beam.modes.V
    y, count = world.state().y, V.shape[1]
    workspace = make_workspace(2, count)
    # The world starts with q̇ = 0: set the momenta to those with the random q̇.
    held = np.setdiff1d(np.arange(2 * n + 2), free_coordinates(n, boundary)).tolist()
    lagrangian = Lagrangian(scenario, held)
    p, p_rate = np.concatenate([pose, q]), np.concatenate([rate, q_dot])
    assert set_momenta(world.system.plant, y, rate, V.T @ world.beam.matrices.M_q @ q_dot, workspace) == 0
    dy, partial = np.zeros_like(y), np.zeros_like(y)
    assert rates_at(world.system, 0.0, y, workspace, dy, True) == 0
    assert rates_at(world.system, 0.0, y, workspace, partial, False) == 0
    return Derivative(world, lagrangian, held, p, p_rate, y, dy, partial)


def test_momenta_are_the_lagrangians_derivatives(derivative: Derivative):
    """P = ∂L/∂ẋ, π = ∂L/∂η̇."""
    momentum = gradient(lambda rate: derivative.lagrangian.kinetic(derivative.p, rate), derivative.p_rate, 0.1)
    V = derivative.world.beam.modes.V
    n = V.shape[1]
    np.testing.assert_allclose(derivative.y[P : P + 3], momentum[:3], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(derivative.y[ETA + n : ETA + 2 * n], V.T @ momentum[3:], rtol=1e-9, atol=1e-9)


def test_coordinates_move_with_their_rates(derivative: Derivative):
    """The kernel recovers ẋ and η̇ from the momenta."""
    V, n = derivative.world.beam.modes.V, derivative.world.beam.modes.V.shape[1]
    np.testing.assert_allclose(derivative.dy[X : X + 3], derivative.p_rate[:3], rtol=0, atol=1e-11)
    np.testing.assert_allclose(V @ derivative.dy[ETA : ETA + n], derivative.p_rate[3:], rtol=0, atol=1e-9)


def test_momenta_change_by_the_lagrangians_gradient_damping_and_pull(derivative: Derivative):
    """Ṗ = ∂L/∂x - ∂U_pull/∂x, π̇ = ∂L/∂η - Dη̇ - ∂U_pull/∂η."""
    lagrangian, V = derivative.lagrangian, derivative.world.beam.modes.V
    n = V.shape[1]

    def total(p):
        return lagrangian(p, derivative.p_rate) - derivative.potential_of_pull(p)

    force = gradient(total, derivative.p, 2e-4)
    force[3:] -= nodal_damping_matrix(derivative.world.beam) @ derivative.p_rate[3:]
    scale = np.abs(force).max()
    np.testing.assert_allclose(derivative.dy[P : P + 3], force[:3], rtol=0, atol=1e-9 * scale)
    expected = V.T @ force[3:]
    np.testing.assert_allclose(
        derivative.dy[ETA + n : ETA + 2 * n], expected, rtol=0, atol=1e-9 * np.abs(expected).max()
    )


def test_the_part_for_exponential_integrators_leaves_out_exactly_the_linear_beam(derivative: Derivative):
    """(η̇, π̇)_whole = (π, -Ω²η - Dπ) + (η̇, π̇)_rest; all other rates are the same, but for the loss, which is left out."""
    modes = derivative.world.beam.modes
    n = len(modes.omega)
    eta, pi = derivative.y[ETA : ETA + n], derivative.y[ETA + n : ETA + 2 * n]
    rest = derivative.partial
    np.testing.assert_array_equal(rest[:DISSIPATED], derivative.dy[:DISSIPATED])
    assert rest[DISSIPATED] == 0
    np.testing.assert_allclose(pi + rest[ETA : ETA + n], derivative.dy[ETA : ETA + n], rtol=1e-9, atol=1e-9)
    whole = -(modes.omega**2) * eta - modes.D @ pi + rest[ETA + n : ETA + 2 * n]
    found = derivative.dy[ETA + n : ETA + 2 * n]
    np.testing.assert_allclose(whole, found, rtol=0, atol=1e-11 * np.abs(found).max())


def test_powers_are_those_of_pull_and_damping(derivative: Derivative):
    """Ẇ = F_pull · Ṙ(s), the dissipation is q̇ᵀDq̇."""
    forward, back = (derivative.p + k * 1e-4 * derivative.p_rate for k in (1, -1))
    power = -(derivative.potential_of_pull(forward) - derivative.potential_of_pull(back)) / 2e-4
    assert derivative.dy[WORK] == pytest.approx(power, rel=1e-6)
    q_dot = derivative.p_rate[3:]
    expected = q_dot @ nodal_damping_matrix(derivative.world.beam) @ q_dot
    assert derivative.dy[DISSIPATED] == pytest.approx(expected, rel=1e-9)


def test_energies_are_those_of_the_points(derivative: Derivative):
    """The sample's kinetic energy is the points' T; its elastic and gravity energy add up to their U (heights from y = 0)."""
    world = World(
        derivative.world.scenario.replace(
            {"initial.pose": derivative.p[:3], "initial.pose_rate": derivative.p_rate[:3]}
            | {"initial.beam_coordinates": derivative.p[3:]}
        )
    )
    sample, still = world.observe(), np.concatenate([derivative.p_rate[:3], 0 * derivative.p[3:]])
    kinetic = derivative.lagrangian.kinetic(derivative.p, still)
    potential = derivative.lagrangian.potential(derivative.p)
    assert sample.kinetic_energy[0] == pytest.approx(kinetic, rel=1e-11)
    assert sample.elastic_energy[0] + sample.gravity_energy[0] == pytest.approx(potential, rel=1e-11)
