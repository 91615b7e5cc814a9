"""Compliant grips: the paper's limit, independent equations, closed forms, energy, live changes, replays, refusals."""

import json

import numpy as np
import pytest
from going_on import check_live, whole_run_as_in_blocks
from grip_equations import Machine
from scipy.linalg import expm

from flexlab.analysis.paper_equations import internal_force_eq_26
from flexlab.analysis.replay import replay
from flexlab.analysis.validation.mass_points import MassPoints
from flexlab.errors import ScenarioError, StudyError
from flexlab.multibody.bodies import make_bodies
from flexlab.physics.beam import beam_matrices
from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.scenario import parse_scenario
from flexlab.sim.closed_loop import own_states_of
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

COMPLIANT = {"grips.model": "compliant"}
SAMPLED = {
    "controller": {
        "kind": "pd",
        "position_gain": (500.0, 500.0, 20.0),
        "velocity_gain": (50.0, 50.0, 1.0),
        "control_period": 0.001,
        "input_delay": 1,
        "sensor_noise": {"pose": (1e-5, 1e-5, 1e-5), "seed": 3},
    }
}
"""A sampled law with gains low enough for its period: the last links, which springs hold, are light."""
WEIGHT, AXIAL = {"gravity": 9.81}, {"payload.axial_load": "first-order"}
JOINTS = {"joints.friction.viscous": (5.0, 5.0, 2.0), "joints.motor.time_constant": 0.004}
FILLED = {"payload.mass_change.factor": 3.0, "payload.mass_change.begin": 0.02, "payload.mass_change.duration": 0.1}
COUNTED = {**SAMPLED, "joints.encoders.counts": (1e6, 1e6, 1e6)}
AT_PAYLOAD = {"grips.measured_at": "payload", "grips.stiffness": (1e7, 1e7, 1e6), "grips.damping": (1e3, 1e3, 100.0)}


def grips(stiffness, damping=(0.0, 0.0, 0.0)) -> dict:
    return {**COMPLIANT, "grips.stiffness": tuple(stiffness), "grips.damping": tuple(damping)}


def imbalance(run: Samples) -> float:
    """Error of the energy balance, relative to the energy moved."""
    put_in = run.input_work + run.axial_work + run.own.get("material_energy", 0.0)
    lost = run.dissipated_energy + run.own.get("friction_loss", 0.0) + run.own["grip_loss"]
    gained = run.total_energy - put_in + lost
    return float(np.abs(gained - gained[0]).max() / (np.abs(np.diff(put_in)).sum() + np.ptp(lost)))


@pytest.mark.parametrize("control", [{}, SAMPLED])
def test_rigid_grips_change_no_bit(control, same_bits):
    plain = load_preset("paper").replace(control)
    assert plain.grips.model == "rigid"
    spelled = plain.replace({"grips.stiffness": (5e4, 5e4, 5e3), "grips.measured_at": "payload"})
    same_bits(simulate(spelled, 0.2), simulate(plain, 0.2))


@pytest.mark.parametrize("measured_at", ["arms", "payload"])
def test_stiff_grips_converge_to_the_papers_rigid_grips_at_first_order(measured_at):
    plain = load_preset("paper").replace({"initial.pose_rate": None})
    exact = simulate(plain.replace({"simulation.integrator": "rk4", "simulation.step": 5e-6}), 0.1)
    after = slice(40, None)  # The ring of the start has faded by then.
    errors = []
    for stiffness in (4e6, 1.6e7, 6.4e7):
        firm = grips([stiffness] * 3, [stiffness**0.5] * 3)
        run = simulate(plain.replace({**firm, "grips.measured_at": measured_at}), 0.1)
        force = np.abs(run.internal_force - exact.internal_force)[after].max() / np.abs(exact.internal_force).max()
        errors.append([np.abs(run.pose - exact.pose)[after].max(), np.abs(run.joint_angle - exact.joint_angle)[after].max(),
                       np.abs(run.midspan_deflection - exact.midspan_deflection)[after].max(), force])  # fmt: skip
    orders = np.log(np.array(errors[:-1]) / errors[1:]) / np.log(4)
    np.testing.assert_allclose(orders[:, :3], 1.0, atol=0.02)
    np.testing.assert_allclose(orders[-1, 3], 1.0, atol=0.1)
    assert max(errors[-1]) < 1e-3


FREE = {"controller.kind": "none", "gravity": 9.81, "initial.pose_rate": (0.6, 0.4, -1.5), "simulation.step": 4e-6}


@pytest.mark.parametrize(
    ("preset", "further", "elements"),
    [
        ("paper", {"initial.pose": (0.05, 0.75, 0.2), "initial.beam_coordinates": (0.02, 0.003, -0.01, -0.02)}, 2),
        (
            "paper",
            {
                "payload.boundary": "clamped-pinned",
                "payload.bending_stiffness": 10.0,
                "controller.control_period": 1e-3,
            },
            3,
        ),
        ("single-arm", {"payload.bending_stiffness": 20.0}, 2),
    ],
)
def test_independent_equations_of_the_same_machine_give_the_same_motion(preset, further, elements):
    free = {
        **FREE,
        "payload.element_count": elements,
        "payload.damping": {"kind": "nodal", "coefficient": 0.1},
        **further,
    }
    scenario = load_preset(preset).replace({**free, **grips((4e4, 2e4, 3e3), (30.0, 20.0, 2.0))})
    machine = Machine(scenario)
    machine.D = 0.1 * np.eye(machine.n)
    run = simulate(scenario, 0.15)
    assert run.status == "finished"
    start = machine.start(run.pose[0], run.pose_rate[0], run.beam_coordinates[0])
    y, n = machine.run(start, np.zeros((2, 3)), run.time), machine.n
    np.testing.assert_allclose(run.pose, y[:, :3], rtol=0, atol=1e-8)
    np.testing.assert_allclose(run.beam_coordinates, y[:, 3 : 3 + n], rtol=0, atol=1e-7)
    for i, side in enumerate(("left", "right")[: len(scenario.arms)]):
        arm = y[:, 6 + 2 * n + 6 * i :]
        turned = np.diff(arm[:, :3], axis=1, prepend=0.0) - run.joint_angle[:, i]
        np.testing.assert_allclose((turned + np.pi) % (2 * np.pi), np.pi, rtol=0, atol=1e-8)
        seen = [machine.grip(i, a[:3], a[3:6], at[:3], at[3 + n : 6 + n]) for a, at in zip(arm, y, strict=True)]
        np.testing.assert_allclose(run.own[f"{side}_grip_displacement"], [one[3] for one in seen], rtol=0, atol=1e-8)
        given = run.internal_force[:, i] + run.moving_force
        pulls = np.array([one[0] for one in seen])
        np.testing.assert_allclose(given[:, :2], pulls, rtol=0, atol=1e-5 * np.abs(pulls).max())
        levers = [one[2] - at[:2] for one, at in zip(seen, y, strict=True)]
        turns = [r[0] * one[0][1] - r[1] * one[0][0] + one[1] for r, one in zip(levers, seen, strict=True)]
        np.testing.assert_allclose(given[:, 2], turns, rtol=0, atol=1e-5 * np.abs(turns).max())
    assert np.abs(run.own["left_grip_displacement"]).max() > 1e-4


def test_the_ring_after_a_tap_is_that_of_a_linear_model_with_mass_points():
    """A matrix exponential gives the linear motion, which shows frequencies and damping of all modes at once."""
    k, c = np.array((5e3, 8e3, 400.0)), np.array((3.0, 4.0, 0.2))
    still = {"controller.kind": "none", "initial.pose": (0.0, 0.75, 0.0), "payload.bending_stiffness": 20.0}
    scenario = load_preset("paper").replace({**grips(k, c), **still, "simulation.step": 1e-5})
    x, points, beam = (
        np.array((0.0, 0.75, 0.0)),
        MassPoints(scenario),
        beam_matrices(0.5, 2.0, 20.0, 2, "pinned-pinned"),
    )
    mass, springs, dampers = np.zeros((3, 13, 13))  # of (x, q, x_1, x_2)
    mass[:3, :3], mass[1, 3:7], mass[2, 3:7] = np.diag([beam.m, beam.m, beam.I]), beam.h, beam.g
    mass[3:7, 1:3], mass[3:7, 3:7] = mass[1:3, 3:7].T, beam.M_q
    springs[3:7, 3:7], dampers[3:7, 3:7] = beam.K_F, 0.1 * np.eye(4)
    for i, side in enumerate((-0.25, 0.25)):
        own = slice(7 + 3 * i, 10 + 3 * i)
        mass[own, own] = points.arm_inertia(x, i)
        apart = np.zeros((3, 13))
        apart[:, own] = np.array([[1, 0, 0], [0, 1, side], [0, 0, 1]])
        apart[:, :3] = -apart[:, own]
        springs += apart.T @ np.diag(k) @ apart
        dampers += apart.T @ np.diag(c) @ apart
    world = World(scenario)
    world.apply(Tap(0.1, (1e-5, 2e-5)))
    run = world.run(300)
    force = np.linalg.solve(mass, np.hstack([-springs, -dampers]))
    flow = expm(0.001 * np.vstack([np.hstack([np.zeros((13, 13)), np.eye(13)]), force]))
    state = np.concatenate(
        [np.zeros(3), run.beam_coordinates[0], np.zeros(6), run.pose_rate[0], run.beam_rates[0], np.zeros(6)]
    )
    moved = np.abs(run.pose - x).max()
    for at in range(301):
        np.testing.assert_allclose(run.pose[at] - x, state[:3], rtol=0, atol=1e-5 * moved)
        np.testing.assert_allclose(run.beam_coordinates[at], state[3:7], rtol=0, atol=1e-5 * moved)
        state = flow @ state
    assert moved > 1e-7


def test_a_payload_between_heavy_arms_rings_at_the_root_of_2k_over_m():
    """Along its axis the beam is rigid: one mass on two springs and two dampers, in closed form."""
    heavy = {f"{side}_arm.link_mass": (1e4,) * 3 for side in ("left", "right")}
    still = {"controller.kind": "none", "initial.pose": (0.0, 0.75, 0.0), "simulation.step": 1e-5}
    world = World(load_preset("paper").replace({**grips((5e3, 8e3, 400.0), (3.0, 4.0, 0.2)), **heavy, **still}))
    world.apply(Tap(0.0, (1e-4, 0.0)))
    run = world.run(300)
    decay, ring = 3.0, np.sqrt(2 * 5e3 - 3.0**2)
    expected = 1e-4 * np.exp(-decay * run.time) * np.sin(ring * run.time) / ring
    np.testing.assert_allclose(run.pose[:, 0], expected, rtol=0, atol=1e-3 * np.abs(expected).max())


def test_a_payload_sags_by_its_weight_over_the_stiffness():
    """The law asks for no moment about the middle, so the moments of the grips balance those of their forces."""
    hold = {"trajectory": {"kind": "hold", "pose": (0.0, 0.75, 0.0)}, **WEIGHT}
    run = simulate(load_preset("paper").replace({**grips((1e5, 4e4, 5e3), (200.0, 200.0, 20.0)), **hold}), 2.0)
    for side, turn in (("left", 1), ("right", -1)):
        along, across, turned = run.own[f"{side}_grip_displacement"][-1]
        assert across == pytest.approx(9.81 / 2 / 4e4, rel=1e-5)
        assert turned == pytest.approx(turn * 0.25 * 9.81 / 2 / 5e3, rel=5e-3)
        assert abs(along) < 1e-3 * across
    np.testing.assert_allclose(run.moving_force[-1], (0, 9.81 / 2, 0), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    "further",
    [
        {}, WEIGHT, {**WEIGHT, **AXIAL, "payload.bending_stiffness": 10.0}, {**WEIGHT, **JOINTS}, SAMPLED, COUNTED,
        {**WEIGHT, **FILLED}, {**FILLED, **JOINTS, **AXIAL, **SAMPLED}, AT_PAYLOAD,
    ],
)  # fmt: skip
@pytest.mark.parametrize("preset", ["paper", "single-arm"])
def test_energy_is_balanced(preset, further):
    run = simulate(load_preset(preset).replace({**COMPLIANT, **further}), 0.2)
    assert run.status == "finished"
    assert imbalance(run) < 1e-6
    assert run.own["grip_loss"][-1] > 0
    assert np.all(np.diff(run.own["grip_loss"]) >= 0)


@pytest.mark.parametrize("link", [None, (1, 1), (1, 3), (2, 2)])
def test_energy_is_balanced_with_a_tap_and_a_pull(link):
    changes = {**COMPLIANT, **WEIGHT, "initial.beam_coordinates": (0.05, 0.006, -0.02, -0.03)}
    world = World(load_preset("paper").replace(changes))
    world.advance(100)
    world.apply(Tap(0.12, (0.3, -0.2)))
    world.apply(Pull(-0.1 if link is None else 0.1, (0.1, 0.9), 2000.0, link))
    run = world.run(200)
    assert imbalance(run) < 1e-8
    free = World(load_preset("paper").replace(changes))
    free.advance(100)
    assert np.abs(free.run(200).pose - run.pose).max() > 1e-4


def test_the_axial_load_at_the_ends_is_the_force_of_the_grips():
    changes = {**COMPLIANT, **AXIAL, "payload.bending_stiffness": 10.0, "controller.wanted_internal_force": 20.0}
    run = simulate(load_preset("paper").replace(changes), 0.3)
    along = np.stack([np.cos(run.pose[:, 2]), np.sin(run.pose[:, 2])], axis=1)
    left, right = (
        np.einsum("ni,ni->n", run.internal_force[:, i, :2] + run.moving_force[:, :2], along) for i in range(2)
    )
    # N is a parabola: extrapolate it from its four places to the ends.
    places = 0.5 * np.array([-0.25 * (1 + 3**-0.5), -0.25 * (1 - 3**-0.5), 0.25 * (1 - 3**-0.5), 0.25 * (1 + 3**-0.5)])
    at_ends = np.array([np.polyval(np.polyfit(places, load, 2), (-0.25, 0.25)) for load in run.axial_load])
    np.testing.assert_allclose(at_ends[:, 0], -left, rtol=0, atol=1e-6 * np.abs(left).max())
    np.testing.assert_allclose(at_ends[:, 1], right, rtol=0, atol=1e-6 * np.abs(left).max())


@pytest.mark.parametrize("further", [{}, COUNTED, {**FILLED, **JOINTS}])
def test_blocks_continued_runs_and_live_runs_have_the_same_bits(further, live):
    scenario = load_preset("paper").replace({**COMPLIANT, **further})
    whole = whole_run_as_in_blocks(scenario, equal_nan=True)
    check_live(live(scenario), whole, "pose", "internal_force", "right_grip_displacement", "grip_loss")


def test_a_recording_replays_bit_for_bit_and_holds_the_signals_of_the_grips(tmp_path):
    run = simulate(load_preset("paper").replace({**COMPLIANT, **WEIGHT}), 0.2)
    recording = read_recording(write_run(run, tmp_path, "compliant"))
    assert replay(recording).identical
    for name in ("left_grip_displacement", "right_grip_displacement", "grip_energy", "grip_loss"):
        assert np.array_equal(recording.samples[name], run[name])


def test_a_scenario_survives_json_and_states_the_units_of_its_grips():
    scenario = load_preset("paper").replace({**grips((1e5, 2e5, 3e3), (1.0, 2.0, 3.0)), "grips.measured_at": "payload"})
    again = parse_scenario(json.loads(scenario.model_dump_json()))
    assert again == scenario
    assert scenario.about("grips.stiffness").unit == "N/m, N/m, N·m/rad"
    assert scenario.about("grips.damping").unit == "N·s/m, N·s/m, N·m·s/rad"


def arms_motion(world: World) -> tuple[np.ndarray, np.ndarray]:
    """Mean pose and pose rate of the arms, from the state."""
    own = own_states_of(world.system, world.state().y)["grips"][:-1].reshape(-1, 6)
    return world.state().y[:3] + own[:, :3].mean(axis=0), own[:, 3:].mean(axis=0)


@pytest.mark.parametrize("measured_at", ["arms", "payload"])
def test_a_controller_measures_the_pose_of_the_arms_or_of_the_payload(measured_at):
    """It asks for the same torques as it would with rigid grips at the measured pose."""
    law = {"trajectory": {"kind": "hold", "pose": (0.1, 0.7, 0.1)}, "controller": {"kind": "pd"}, **WEIGHT}
    start = {"initial.pose": (0.05, 0.72, 0.0), "initial.pose_rate": (0.5, 0.3, -0.4)}
    rigid = load_preset("paper").replace({**law, **start})
    soft = grips((2e5, 2e5, 2e4), (2e3, 2e3, 200.0))
    world = World(rigid.replace({**soft, "grips.measured_at": measured_at}))
    for _ in range(4):
        world.advance(7)
        seen = world.observe()
        pose, rate = arms_motion(world) if measured_at == "arms" else (seen.pose[0], seen.pose_rate[0])
        told = World(rigid.replace({"initial.pose": tuple(pose), "initial.pose_rate": tuple(rate)})).observe()
        size = np.abs(told.joint_torque).max()
        np.testing.assert_allclose(seen.joint_torque, told.joint_torque, rtol=0, atol=1e-11 * size)
        assert np.abs(arms_motion(world)[0] - seen.pose[0]).max() > 1e-6


def test_encoders_measure_the_arms_even_if_the_pose_is_measured_at_the_payload():
    fine = {**COMPLIANT, **COUNTED, "joints.encoders.counts": (1e9, 1e9, 1e9)}
    world = World(load_preset("paper").replace({**fine, "grips.measured_at": "payload"}))
    for _ in range(3):
        world.advance(20)
        told = own_states_of(world.system, world.state().y)["reading"]
        np.testing.assert_allclose(told, arms_motion(world)[0], rtol=0, atol=2e-8)
        assert np.abs(told - world.state().y[:3]).max() > 1e-6


def test_grips_can_change_during_a_run():
    plain = load_preset("paper")
    world = World(plain)
    world.advance(100)
    before = world.observe()
    assert world.apply(ChangeScenario(COMPLIANT))  # Rows have other columns: a new run; the motion goes on.
    after = world.observe()
    np.testing.assert_allclose(after.pose_rate, before.pose_rate, rtol=0, atol=1e-12)
    np.testing.assert_allclose(after.beam_rates, before.beam_rates, rtol=0, atol=1e-9)
    np.testing.assert_allclose(after.kinetic_energy, before.kinetic_energy, rtol=1e-9)
    assert after.own["left_grip_displacement"].max() == 0
    world.advance(50)
    before = world.observe()
    assert not world.apply(ChangeScenario({"grips.damping": (300.0, 300.0, 30.0)}))
    after = world.observe()
    for name in ("kinetic_energy", "elastic_energy", "left_grip_displacement", "grip_loss"):
        np.testing.assert_allclose(after[name], before[name], rtol=1e-9, atol=1e-15)
    world.apply(ChangeScenario({"payload.bending_stiffness": 120.0}))
    after = world.observe()
    np.testing.assert_allclose(after.own["left_grip_displacement"], before.own["left_grip_displacement"], rtol=1e-12)
    np.testing.assert_allclose(after.kinetic_energy, before.kinetic_energy, rtol=1e-9)
    world.advance(50)
    world.apply(ChangeScenario({"grips.model": "rigid"}))
    assert "grip_energy" not in world.observe().own
    assert world.integrator == "etdrk4"
    world.advance(100)
    assert not world.status.failed


@pytest.mark.parametrize("preset", ["paper", "soft-beam", "gravity"])
@pytest.mark.parametrize(
    "held", [grips((1e3, 1e3, 100.0)), grips((1e5, 1e5, 1e4), (100, 100, 10)), grips((1e7, 1e7, 1e5))]
)
def test_automatic_steps_are_short_enough_for_the_grips(preset, held):
    scenario = load_preset(preset).replace(
        {**held, "controller.kind": "none"} if held == grips((1e3, 1e3, 100.0)) else held
    )
    world = World(scenario)
    assert world.integrator == "rk4"
    run = world.run(150)
    finer = simulate(scenario.replace({"simulation.step": world.step / 4}), 0.15)
    np.testing.assert_allclose(run.pose, finer.pose, rtol=0, atol=1e-8)
    force = max(0.5, np.abs(finer.internal_force).max())
    np.testing.assert_allclose(run.internal_force, finer.internal_force, rtol=0, atol=1e-4 * force)


def test_an_arm_that_leaves_its_workspace_on_soft_grips_is_named():
    soft = {**grips((50.0, 50.0, 5.0)), "controller.kind": "none", "gravity": 9.81}
    run = simulate(load_preset("paper").replace(soft), 2.0)
    assert run.status == "singular"
    assert "arm left its workspace" in run.status.text


def test_impossible_grips_are_refused_with_a_reason():
    paper = load_preset("paper").replace(COMPLIANT)
    for name, value, said in (
        (
            "stiffness",
            (1e5, 0.0, 1e4),
            r"grips\.stiffness = \(100000\.0, 0\.0, 10000\.0\) N/m.*1 to 10⁹ N/m, N/m, N·m/rad",
        ),
        (
            "damping",
            (-1.0, 0.0, 0.0),
            r"grips\.damping = \(-1\.0, 0\.0, 0\.0\) N·s/m.*0 to 1000000 N·s/m, N·s/m, N·m·s/rad",
        ),
        ("model", "loose", r"grips\.model = 'loose'.*'rigid'.*'compliant'"),
    ):
        with pytest.raises(ScenarioError, match=said):
            paper.replace({f"grips.{name}": value})
    for integrator in ("etdrk4", "generalized-alpha"):
        with pytest.raises(
            ScenarioError,
            match=rf"{integrator} \(.*\) needs rigid grips.*choose the integrator auto or rk4, or rigid grips",
        ):
            paper.replace({"simulation.integrator": integrator})
    with pytest.raises(ScenarioError, match=r"is unstable with rk4: the grips allow.*Choose a shorter step, or null"):
        World(paper.replace({"grips.stiffness": (1e9, 1e9, 1e9), "simulation.step": 1e-4}))
    with pytest.raises(
        ScenarioError, match=r"grips' stiffness and damping would need a step .*lower stiffness .*\(grips\.stiffness,"
    ):
        World(paper.replace({"grips.damping": (1e6, 1e6, 1e6)}))
    slow = World(paper.replace({"grips.stiffness": (1e8, 1e8, 1e8)}))
    assert "the grips need steps of" in slow.pace_warning
    assert "rigid grips (grips.model = rigid)" in slow.pace_warning
    both = paper.replace({"payload.mass_change.factor": 2.0, "payload.element_count": 64})
    with pytest.raises(
        ScenarioError, match=r"or a mass that stays \(.*factor = 1\) and rigid grips \(grips\.model = rigid\),"
    ):
        World(both)


def test_what_needs_rigid_grips_refuses_compliant_ones_or_says_so():
    from flexlab.fmi.parts import make_part
    from flexlab.gym_environment.worlds import Settings, WorldBatch

    compliant = load_preset("paper").replace(COMPLIANT)
    with pytest.raises(StudyError, match=r"grips\.model = compliant cannot be used in the environment"):
        WorldBatch(Settings(scenario=compliant), 1)
    with pytest.raises(StudyError, match=r"grips\.measured_at payload or grips\.model rigid"):
        make_part(compliant, "law", 0.001)
    with pytest.raises(StudyError, match=r"Eq. \(26\) holds for rigid grips"):
        internal_force_eq_26(simulate(compliant, 0.01))
    assert "The grips are rigid here." in make_bodies(compliant).about()
    assert "grips are rigid" not in make_bodies(load_preset("paper")).about()


@pytest.mark.parametrize("changes", [{}, WEIGHT, JOINTS, FILLED, COUNTED, AXIAL], ids=str)
def test_an_unreachable_path_is_reported_with_every_extension(changes: dict):
    far = load_preset("paper").replace(COMPLIANT | changes | {"left_arm.base": (-20.0, -20.0)})
    run = simulate(far, 0.01)
    assert str(run.status) == "unreachable"
    assert "left arm" in run.status.text
    assert len(run) <= 1
