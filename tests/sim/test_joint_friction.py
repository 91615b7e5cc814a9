"""Friction in the joints: stick-slip against exact Coulomb friction, energy, steps, compensation, same bits, refusals."""

import numpy as np
import pytest
from going_on import whole_run_as_in_blocks
from scipy.integrate import solve_ivp

import flexlab
from flexlab.analysis.paper_equations import internal_force_eq_26
from flexlab.errors import ScenarioError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

FRICTION = {
    "joints.friction.viscous": (5.0, 5.0, 2.0),
    "joints.friction.coulomb": (8.0, 6.0, 2.0),
    "joints.friction.static_factor": 1.5,
}
PLANT = [{}, {"controller.control_period": 0.001}]

COULOMB, STATIC, SPEED, VISCOUS = np.array([6.0, 4.0, 1.0]), 1.6, 0.05, np.array([0.5, 0.5, 0.1])
GAINS, RATE_GAINS = np.array([150.0, 120.0, 40.0]), np.array([5.0, 5.0, 1.0])
DURATION = 2.5
STEPS = 1e-6 * np.concatenate([np.eye(3), -np.eye(3)])


def sticking(smoothing: float) -> Scenario:
    """One arm with a stiff beam, led along a slow path by a joint controller with low gains."""
    return load_preset("single-arm").replace(
        {
            "controller.kind": "joint-pd",
            "controller.position_gain": tuple(GAINS),
            "controller.velocity_gain": tuple(RATE_GAINS),
            "payload.bending_stiffness": 1e5,
            "trajectory.frequency": (0.4, 0.4, 0.4),
            "trajectory.amplitude": (0.1, 0.08, 0.1),
            "initial.pose_rate": None,
            "joints.friction.viscous": tuple(VISCOUS),
            "joints.friction.coulomb": tuple(COULOMB),
            "joints.friction.static_factor": STATIC,
            "joints.friction.stribeck_speed": SPEED,
            "joints.friction.smoothing_speed": smoothing,
        }
    )


class ExactArm:
    """Three links and a rigid payload with discontinuous Coulomb friction: joints stick or slip, and events find the changes."""

    def __init__(self, scenario: Scenario):
        arm, payload = scenario.left_arm, scenario.payload
        l1, l2, l3 = arm.link_length
        (a1, a2, a3), (m1, m2, m3), m = arm.link_center, arm.link_mass, payload.linear_density * payload.length
        half = payload.length / 2
        reach = np.array([[a1, 0, 0], [l1, a2, 0], [l1, l2, a3], [l1, l2, l3 + half]])
        self.inertia = np.einsum("b,bi,bj->ij", np.array([m1, m2, m3, m]), reach, reach)
        self.own = np.array([arm.inertia[0], arm.inertia[1], arm.inertia[2] + m * payload.length**2 / 12])
        self.base, self.links, self.back = np.array(arm.base), (l1, l2), l3 + half
        self.path = scenario.trajectory

    def desired(self, t: float) -> np.ndarray:
        """Joint angles of the path, (3,)."""
        turn = 2 * np.pi * np.array(self.path.frequency) * t + np.array(self.path.phase)
        x, y, theta = np.array(self.path.center) + np.array(self.path.amplitude) * np.sin(turn)
        (l1, l2), wrist = (
            self.links,
            np.array([x, y]) - self.back * np.array([np.cos(theta), np.sin(theta)]) - self.base,
        )
        bend = -np.arccos((wrist @ wrist - l1**2 - l2**2) / (2 * l1 * l2))
        first = np.arctan2(wrist[1], wrist[0]) - np.arctan2(l2 * np.sin(bend), l1 + l2 * np.cos(bend))
        return np.array([first, bend, theta - first - bend])

    def motors(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Torques of the joint controller, N·m."""
        rate = (self.desired(t + 1e-6) - self.desired(t - 1e-6)) / 2e-6
        return -GAINS * (q - self.desired(t)) - RATE_GAINS * (v - rate)

    def dynamics(self, t: float, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix in the relative joint angles, and all torques but friction."""
        chain = np.tril(np.ones((3, 3)))
        alpha, rate = chain @ q, chain @ v
        between = alpha[:, None] - alpha
        mass = chain.T @ (self.inertia * np.cos(between) + np.diag(self.own)) @ chain
        return mass, self.motors(t, q, v) - chain.T @ ((self.inertia * np.sin(between)) @ rate**2)

    def sliding(self, v: np.ndarray) -> np.ndarray:
        """Magnitude of dry friction at these speeds, N·m."""
        return COULOMB * (1 + (STATIC - 1) / (1 + (v / SPEED) ** 2))

    def accelerations(self, t: float, q: np.ndarray, v: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations of the joints, and friction in those that stick, N·m; way: sign of the slip, 0 if it sticks."""
        mass, force = self.dynamics(t, q, v)
        force = force - VISCOUS * v - way * self.sliding(v)
        free, a = way != 0, np.zeros(3)
        a[free] = np.linalg.solve(mass[np.ix_(free, free)], force[free]) if free.any() else 0
        return a, np.where(free, 0.0, force - mass @ a)

    def run(self, q: np.ndarray, v: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, int]:
        """Joint angles at `times`, and how often a joint begins or ceases to stick."""
        way, t, angles, changes = np.sign(v), 0.0, np.empty((len(times), 3)), 0
        while True:

            def rates(t, z, way=way):
                return np.concatenate([z[3:], self.accelerations(t, z[:3], z[3:], way)[0]])

            def event(joint, way=way):
                def passes(time, z):
                    if way[joint] != 0:
                        return z[3 + joint] * way[joint]
                    held = self.accelerations(time, np.array(z[:3]), np.array(z[3:]), way)[1]
                    return COULOMB[joint] * STATIC - abs(held[joint])

                passes.terminal, passes.direction = True, -1
                return passes

            found = solve_ivp(
                rates, (t, times[-1]), [*q, *v], "DOP853", dense_output=True, rtol=1e-10, atol=1e-12,
                events=[event(joint) for joint in range(3)],
            )  # fmt: skip
            inside = (times >= t) & (times <= found.t[-1])
            if inside.any():
                angles[inside] = found.sol(times[inside])[:3].T
            t, q, v = found.t[-1], found.y[:3, -1].copy(), found.y[3:, -1].copy()
            if found.status == 0:
                return angles, changes
            joint, changes, way = next(j for j in range(3) if len(found.t_events[j])), changes + 1, way.copy()
            if way[joint] == 0:
                way[joint] = np.sign(self.accelerations(t, q, v, way)[1][joint])
            else:
                way[joint] = v[joint] = 0.0
                held = self.accelerations(t, q, v, way)[1][joint]
                if abs(held) > COULOMB[joint] * STATIC:
                    way[joint] = np.sign(held)


@pytest.fixture(scope="module")
def exact() -> tuple[np.ndarray, int]:
    """Joint angles (N, 3) of the arm with discontinuous friction, and how often its joints begin or cease to stick."""
    scenario = sticking(0.01)
    arm, start = ExactArm(scenario), simulate(scenario, 0.001)
    v = (arm.desired(1e-6) - arm.desired(-1e-6)) / 2e-6
    return arm.run(start.joint_angle[0, 0], v, np.arange(0, DURATION + 5e-4, 1e-3))


def test_stick_slip_converges_to_that_of_discontinuous_friction(exact):
    angles, changes = exact
    moved = np.ptp(angles, axis=0)
    assert changes > 10
    assert (moved > 0.1).all()
    errors = []
    for smoothing in (3e-3, 1e-3):
        run = simulate(sticking(smoothing), DURATION)
        assert run.status.text == f"Finished at t = {DURATION:g} s."
        errors.append(np.abs(run.joint_angle[:, 0] - angles).max())
        turned = np.count_nonzero(np.diff(np.sign(run.own["left_joint_friction"]), axis=0))
        assert turned <= changes  # it does not chatter
    # What remains is creep, in proportion to the smoothing speed.
    assert errors[1] < 0.01 * moved.max()
    assert errors[1] < 0.45 * errors[0]


@pytest.mark.parametrize("control", PLANT)
@pytest.mark.parametrize("integrator", ["rk4", "etdrk4", "generalized-alpha"])
def test_energy_is_balanced(integrator, control):
    scenario = load_preset("paper").replace({**FRICTION, **control, "simulation.integrator": integrator})
    run = simulate(scenario.replace({"simulation.step": 1e-5}), 0.2)
    lost = run.own["friction_loss"]
    gained = np.abs(run.total_energy - run.total_energy[0] - run.input_work + run.dissipated_energy + lost).max()
    assert (np.diff(lost) >= 0).all()
    assert lost[-1] > 10
    assert gained < 2e-7 * run.input_work.max()


@pytest.mark.parametrize("integrator", ["rk4", "generalized-alpha"])
def test_all_integrators_find_the_same_motion(integrator):
    scenario = load_preset("paper").replace(FRICTION)
    one, other = (simulate(scenario.replace({"simulation.integrator": name}), 0.2) for name in ("etdrk4", integrator))
    np.testing.assert_allclose(one.pose, other.pose, rtol=0, atol=2e-8)
    np.testing.assert_allclose(one.internal_force, other.internal_force, atol=1e-4 * np.abs(one.internal_force).max())


@pytest.mark.parametrize("control", PLANT)
@pytest.mark.parametrize("smoothing", [0.1, 0.01, 0.001])
def test_automatic_steps_resolve_friction(smoothing, control):
    scenario = load_preset("paper").replace({**FRICTION, **control, "joints.friction.smoothing_speed": smoothing})
    step, run = World(scenario).step, simulate(scenario, 0.5)
    assert run.status.text == "Finished at t = 0.5 s."
    finer = simulate(scenario.replace({"simulation.step": step / 8}), 0.5)
    np.testing.assert_allclose(run.pose, finer.pose, rtol=0, atol=1e-8)
    force = np.abs(finer.internal_force).max()
    np.testing.assert_allclose(run.internal_force, finer.internal_force, rtol=0, atol=1e-4 * force)


def test_a_controller_that_knows_friction_moves_as_if_there_were_none():
    plain = load_preset("paper")
    known = plain.replace({**FRICTION, "controller.model.friction_factor": 1.0})
    ideal, run = simulate(plain, 0.5), simulate(known, 0.5)
    np.testing.assert_allclose(run.pose, ideal.pose, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.internal_force, ideal.internal_force, rtol=0, atol=1e-2)
    friction = np.stack([run.own["left_joint_friction"], run.own["right_joint_friction"]], axis=1)
    np.testing.assert_allclose(run.joint_torque - friction, ideal.joint_torque, rtol=0, atol=1e-2)


def test_a_sampled_controller_that_knows_friction_tracks_better():
    sampled = {**FRICTION, "controller.control_period": 0.001}
    runs = [
        simulate(load_preset("paper").replace({**sampled, "controller.model.friction_factor": factor}), 1.5)
        for factor in (0.0, 1.0)
    ]
    unknown, known = (np.abs(run.tracking_error[run.time > 0.5]).max() for run in runs)
    assert known < 0.5 * unknown


@pytest.mark.parametrize("control", PLANT)
def test_blocks_and_continued_runs_have_the_same_bits(control):
    whole_run_as_in_blocks(load_preset("paper").replace({**FRICTION, **control}))


def test_friction_can_begin_and_end_during_a_run():
    plain, world = load_preset("paper"), World(load_preset("paper"))
    world.advance(100)
    before = world.observe()
    assert world.apply(ChangeScenario(FRICTION))  # Rows have other columns: a new run; the motion goes on.
    after = world.observe()
    np.testing.assert_allclose(after.pose_rate, before.pose_rate, rtol=0, atol=1e-12)
    assert after.own["friction_loss"][0] == 0
    assert np.abs(after.own["left_joint_friction"]).max() > 1
    lost = world.advance(100).own["friction_loss"][-1]
    world.apply(ChangeScenario({"payload.bending_stiffness": 120.0}))
    assert world.observe().own["friction_loss"][0] == lost > 0
    world.apply(ChangeScenario({"joints": plain.joints}))
    assert "friction_loss" not in world.observe().own
    assert len(world.advance(100)) == 100


def test_the_linear_model_includes_viscous_friction():
    plain, viscous = load_preset("paper"), {"joints.friction.viscous": (5.0, 4.0, 2.0)}
    one, other = (flexlab.linearize(scenario) for scenario in (plain, plain.replace(viscous)))
    moved = [simulate(plain.replace({"initial.pose": tuple(one.about.pose + step)}), 0.0) for step in STEPS]
    J = np.stack([(moved[a].joint_angle - moved[3 + a].joint_angle)[0] for a in range(3)], axis=-1) / 2e-6
    expected = sum(j.T @ np.diag([5.0, 4.0, 2.0]) @ j for j in J)
    np.testing.assert_allclose((other.damping - one.damping)[:3, :3], expected, rtol=1e-6, atol=1e-6)


def test_internal_forces_agree_with_eq_26():
    run = simulate(load_preset("paper").replace(FRICTION), 0.1)
    np.testing.assert_allclose(internal_force_eq_26(run), run.internal_force, rtol=0, atol=1e-7)


def test_impossible_friction_is_refused_with_a_reason():
    with pytest.raises(ScenarioError, match=r"joints\.friction\.viscous.*0 to 10000 N·m·s/rad"):
        load_preset("paper").replace({"joints.friction.viscous": (-1.0, 0.0, 0.0)})
    strong = {"joints.friction.coulomb": (1e4,) * 3, "joints.friction.smoothing_speed": 1e-6}
    with pytest.raises(ScenarioError, match=r"joints' friction would need a step .*smoothing_speed"):
        World(load_preset("paper").replace(strong))
