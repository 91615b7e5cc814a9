"""A payload that is filled or emptied: same bits, energy, closed forms, the motion afterwards, live changes, refusals."""

import numpy as np
import pytest
from going_on import check_live, whole_run_as_in_blocks

import flexlab
from flexlab.analysis.paper_equations import internal_force_eq_26
from flexlab.analysis.replay import replay
from flexlab.control.laws.proportional_derivative import ProportionalDerivative
from flexlab.errors import ScenarioError, StudyError
from flexlab.multibody.bodies import make_bodies
from flexlab.presets import load_preset
from flexlab.recording.headless import write_run
from flexlab.recording.reader import read_recording
from flexlab.scenario.payload import NodalDamping
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.samples import Samples
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

SAMPLED = {
    "controller.control_period": 0.001,
    "controller.input_delay": 1,
    "controller.sensor_noise": {"pose": (1e-5, 1e-5, 1e-5), "strain": 1e-7, "seed": 3},
}
CONTROL = [{}, SAMPLED]
AXIAL, WEIGHT = {"payload.axial_load": "first-order"}, {"gravity": 9.81}
JOINTS = {"joints.friction.viscous": (5.0, 5.0, 2.0), "joints.motor.time_constant": 0.004}


def change(factor: float, begin: float = 0.05, duration: float = 0.1) -> dict:
    names = {"factor": factor, "begin": begin, "duration": duration}
    return {f"payload.mass_change.{name}": value for name, value in names.items()}


def imbalance(run: Samples) -> float:
    """Error of the energy balance, relative to the energy moved."""
    put_in = run.input_work + run.axial_work + run.own["material_energy"]
    lost = run.dissipated_energy + run.own.get("friction_loss", 0.0)
    gained = run.total_energy - put_in + lost
    moved = np.abs(np.diff(run.input_work)).sum() + np.ptp(run.dissipated_energy) + np.ptp(run.own["material_energy"])
    return float(np.abs(gained - gained[0]).max() / moved)


@pytest.mark.parametrize("control", CONTROL)
@pytest.mark.parametrize("integrator", ["auto", "rk4"])
def test_a_factor_of_one_changes_no_bit(control, integrator, same_bits):
    plain = load_preset("paper").replace({**control, "simulation.integrator": integrator})
    same_bits(simulate(plain.replace(change(1.0)), 0.2), simulate(plain, 0.2))


@pytest.mark.parametrize("factor", [0.3, 4.0])
@pytest.mark.parametrize("further", [{}, WEIGHT, {**WEIGHT, **AXIAL}, {**WEIGHT, **JOINTS}, SAMPLED])
def test_energy_is_balanced_with_the_energy_that_material_brings(factor, further):
    run = simulate(load_preset("paper").replace({**change(factor), **further}), 0.3)
    assert run.status == "finished"
    np.testing.assert_allclose(run.own["payload_mass"][[0, -1]], (1.0, factor), rtol=1e-15)
    assert imbalance(run) < 1e-6
    assert np.ptp(run.own["material_energy"]) > 0.01


@pytest.mark.parametrize("further", [{}, AXIAL])
def test_energy_is_balanced_with_a_tap_and_a_pull(further):
    changes = {**change(2.5), **WEIGHT, **further, "initial.beam_coordinates": (0.05, 0.006, -0.02, -0.03)}
    world = World(load_preset("paper").replace(changes))
    world.advance(100)
    world.apply(Tap(0.12, (0.3, -0.2)))
    world.apply(Pull(-0.1, (0.1, 0.9), 2000.0))
    assert imbalance(world.run(200)) < 1e-9


def test_energy_is_balanced_with_one_arm():
    run = simulate(load_preset("spin-up").replace(change(0.5, 0.1, 0.3)), 1.0)
    assert imbalance(run) < 1e-6


@pytest.mark.parametrize("preset", ["paper", "single-arm", "spin-up"])
@pytest.mark.parametrize("factor", [0.4, 3.0])
@pytest.mark.parametrize("control", [{}, SAMPLED, {**WEIGHT, **AXIAL, "payload.bending_stiffness": 5.0}])
def test_after_the_change_all_signals_are_those_of_a_payload_of_the_new_density(preset, factor, control):
    """Weight, forces along and across the beam, deflection and energies agree."""
    still = {"simulation.integrator": "rk4", "simulation.step": 5e-6, "payload.damping": NodalDamping(coefficient=0.01)}
    still |= {"payload.element_count": 2}  # No mode is so fast that the axial load takes it as moving with the link.
    # This law uses no beam rates, and its gains are low enough for any control period.
    law = ProportionalDerivative(position_gain=(500.0, 500.0, 20.0), velocity_gain=(50.0, 50.0, 1.0))
    scenario = load_preset(preset).replace({"controller": law})
    worlds = [World(scenario.replace({**change(factor), **still, **control})) for _ in range(2)]
    for world in worlds:
        world.advance(160)
    density = factor * worlds[1].scenario.payload.linear_density
    heavy = {"payload.mass_change.factor": 1.0, "payload.linear_density": density}
    worlds[1].apply(ChangeScenario({**heavy, "controller.model.linear_density_factor": 1 / factor}))
    changed, always = (world.run(100).signals() for world in worlds)
    assert not worlds[0].status.failed
    for name, values in always.items():
        scale = max(1e-9, float(np.nanmax(np.abs(values), initial=0.0)))
        np.testing.assert_allclose(changed[name] / scale, values / scale, rtol=0, atol=2e-8, err_msg=name)
    assert set(changed) - set(always) == {"payload_mass", "material_energy"}


KNOWN = {"controller.model.mass_change_factor": 1.0}


@pytest.mark.parametrize(
    "kind", ["pd", "computed-torque", "adaptive-sliding-mode", "disturbance-observer", "super-twisting"]
)
@pytest.mark.parametrize("control", [{}, {"control_period": 1e-3, "input_delay": 1}])
def test_a_law_that_knows_the_change_then_acts_as_for_the_heavy_payload(kind, control):
    still = {"simulation.integrator": "rk4", "simulation.step": 2e-5, "payload.damping": NodalDamping(coefficient=0.01)}
    scenario = load_preset("paper").replace({"controller": {"kind": kind, **control}, **WEIGHT, **still})
    worlds = [World(scenario.replace({**change(3.0), **KNOWN})) for _ in range(2)]
    for world in worlds:
        world.advance(160)
    density = 3.0 * worlds[1].scenario.payload.linear_density
    worlds[1].apply(ChangeScenario({"payload.mass_change.factor": 1.0, "payload.linear_density": density}))
    changed, always = (world.run(100) for world in worlds)
    np.testing.assert_allclose(changed.pose, always.pose, rtol=0, atol=1e-9)
    np.testing.assert_allclose(changed.joint_torque, always.joint_torque, rtol=0, atol=2e-6)


@pytest.mark.parametrize("part", [0.0, 0.4, 1.0])
def test_a_payload_sags_by_the_weight_that_its_law_does_not_know(part):
    hold = {"trajectory": {"kind": "hold", "pose": (0.0, 0.75, 0.0)}, **WEIGHT, "controller.kind": "pd"}
    gains = {"controller.position_gain": (2e3, 2e3, 1e3), "controller.velocity_gain": (200.0, 200.0, 100.0)}
    known = {"controller.model.mass_change_factor": part}
    run = simulate(load_preset("paper").replace(hold).replace({**gains, **change(3.0), **known}), 3.0)
    assert run.tracking_error[-1, 1] == pytest.approx(-(1 - part) * 2.0 * 9.81 / 2e3, rel=1e-6, abs=1e-9)


def test_an_observer_that_knows_the_change_does_not_take_it_for_a_disturbance():
    """Along its axis the beam is rigid: without material, the observer sees no disturbance there."""
    along = {"controller.kind": "disturbance-observer", "trajectory.amplitude": (0.2, 0.0, 0.0)}
    scenario = load_preset("paper").replace(along).replace(change(3.0, 0.4, 0.2))
    unknown, known = (
        np.abs(simulate(scenario.replace(belief), 0.7).own["disturbance_estimate"][:, 0]).max()
        for belief in ({}, KNOWN)
    )
    assert unknown > 1
    assert known < 1e-4


def test_a_free_payload_keeps_its_velocity_and_resists_a_pull_with_its_new_mass():
    arms = {f"{side}_arm.link_mass": (1e-7,) * 3 for side in ("left", "right")}
    still = {"controller.kind": "none", "initial.pose": (0.0, 0.75, 0.0), "initial.pose_rate": (0.3, 0.0, 0.0)}
    for factor in (0.3, 4.0):
        world = World(load_preset("paper").replace({**change(factor), **arms, **still}))
        run = world.run(200)
        np.testing.assert_allclose(run.pose_rate, [(0.3, 0.0, 0.0)] * 201, rtol=0, atol=1e-6)
        np.testing.assert_allclose(run.pose_acceleration, 0.0, atol=1e-4)
        world.apply(Pull(0.0, (0.9, 0.75), 5.0))
        start, pulled = world.observe(), world.advance(50)
        force = 5.0 * (0.9 - np.append(start.pose[:, 0], pulled.pose[:, 0]))
        gained = np.trapezoid(force, dx=0.001) / factor
        assert pulled.pose_rate[-1, 0] - start.pose_rate[0, 0] == pytest.approx(gained, rel=1e-5)


@pytest.mark.parametrize("at", [-0.1, 0.2])
def test_a_tap_does_the_work_of_an_impulse_while_the_mass_changes(at):
    changes = {**change(3.0), "initial.beam_coordinates": (0.05, 0.006, -0.02, -0.03)}
    world = World(load_preset("paper").replace(changes))
    before = world.run(100).slice(100, 101)
    impulse = np.array([0.4, 0.9])
    world.apply(Tap(at, tuple(impulse)))
    after = world.observe()
    from flexlab.sim.build import payload_row

    row = payload_row(world.scenario.payload, at)
    speeds = []
    for sample in (before, after):
        c, s, turn = np.cos(sample.pose[0, 2]), np.sin(sample.pose[0, 2]), sample.pose_rate[0, 2]
        w, w_rate = sample.beam_coordinates[0] @ row, sample.beam_rates[0] @ row
        moved = at * turn + w_rate
        speeds.append(sample.pose_rate[0, :2] + np.array([-s * moved - c * w * turn, c * moved - s * w * turn]))
    gained = after.kinetic_energy[0] - before.kinetic_energy[0]
    assert gained == pytest.approx(impulse @ (speeds[0] + speeds[1]) / 2, rel=1e-9)


@pytest.mark.parametrize("control", CONTROL)
def test_blocks_continued_runs_and_live_runs_have_the_same_bits(control, live):
    scenario = load_preset("paper").replace({**change(2.0), **control})
    check_live(live(scenario), whole_run_as_in_blocks(scenario), "pose", "internal_force", "material_energy")


def test_a_recording_replays_bit_for_bit_and_holds_the_signals_of_the_change(tmp_path):
    run = simulate(load_preset("paper").replace(change(2.0)), 0.2)
    recording = read_recording(write_run(run, tmp_path, "filled"))
    assert replay(recording).identical
    for name in ("payload_mass", "material_energy"):
        assert np.array_equal(recording.samples[name], run[name])


@pytest.mark.parametrize("factor", [0.3, 4.0])
@pytest.mark.parametrize("preset", ["paper", "soft-beam", "gravity"])
def test_automatic_steps_are_short_enough_for_the_lightest_payload(preset, factor):
    scenario = load_preset(preset).replace(change(factor))
    world = World(scenario)
    assert world.integrator == "rk4"
    first = world.first_frequency
    world.advance(160)
    assert world.first_frequency == pytest.approx(first / factor**0.5, rel=1e-14)
    run = simulate(scenario, 0.4)
    finer = simulate(scenario.replace({"simulation.step": world.step / 4}), 0.4)
    np.testing.assert_allclose(run.pose, finer.pose, rtol=0, atol=1e-8)
    force = np.abs(finer.internal_force).max()
    np.testing.assert_allclose(run.internal_force, finer.internal_force, rtol=0, atol=1e-4 * force)


def test_internal_forces_agree_with_eq_26():
    run = simulate(load_preset("paper").replace({**change(3.0), **WEIGHT}), 0.2)
    away = np.abs(internal_force_eq_26(run, 7) - run.internal_force[::7]).max()
    assert away < 1e-9 * np.abs(run.internal_force).max()


def test_a_mass_change_can_begin_and_end_during_a_run_without_a_jump():
    plain = load_preset("paper")
    world = World(plain)
    world.advance(100)
    before = world.observe()
    assert world.apply(ChangeScenario(change(2.0, 0.15)))  # Rows have other columns: a new run; the motion goes on.
    after = world.observe()
    np.testing.assert_allclose(after.pose_rate, before.pose_rate, rtol=0, atol=1e-12)
    np.testing.assert_allclose(after.beam_rates, before.beam_rates, rtol=0, atol=1e-9)
    assert after.own["material_energy"][0] == 0
    brought = world.advance(80).own["material_energy"][-1]
    before = world.observe()
    world.apply(ChangeScenario({"payload.bending_stiffness": 120.0}))
    after = world.observe()
    assert after.own["material_energy"][0] == brought != 0
    np.testing.assert_allclose(after.kinetic_energy, before.kinetic_energy, rtol=1e-12)
    world.apply(ChangeScenario({"payload.mass_change.factor": 0.5}))  # At once it is as light as with that factor.
    np.testing.assert_allclose(world.observe().pose_rate, before.pose_rate, rtol=0, atol=1e-12)
    world.advance(100)
    world.apply(ChangeScenario({"payload.mass_change": plain.payload.mass_change}))
    assert "material_energy" not in world.observe().own
    assert world.integrator == "etdrk4"
    world.advance(100)
    assert not world.status.failed


def test_poles_and_modes_are_those_of_the_start():
    plain = load_preset("paper")
    one, other = flexlab.modes(plain.replace(change(3.0))), flexlab.modes(plain)
    np.testing.assert_allclose(one.poles, other.poles, rtol=1e-9)


def test_an_impossible_mass_change_is_refused_with_a_reason():
    paper = load_preset("paper")
    for name, value, said in (
        ("factor", 0.0, r"payload\.mass_change\.factor = 0 .*0\.05 to 20"),
        ("factor", float("nan"), r"payload\.mass_change\.factor"),
        ("begin", -1.0, r"payload\.mass_change\.begin = -1 s .*0 to 10000 s"),
        ("duration", 0.0, r"payload\.mass_change\.duration = 0 s .*0\.01 to 10000 s"),
    ):
        with pytest.raises(ScenarioError, match=said):
            paper.replace({f"payload.mass_change.{name}": value})
    for integrator in ("etdrk4", "generalized-alpha"):
        with pytest.raises(
            ScenarioError,
            match=rf"^the integrator {integrator} \(simulation\.integrator\) needs a mass .* factor of 3 .*: choose the",
        ):
            paper.replace({**change(3.0), "simulation.integrator": integrator})
    with pytest.raises(ScenarioError, match=r"is unstable with rk4.*Choose a shorter step, or null"):
        World(paper.replace({**change(3.0), "simulation.step": 1e-3}))
    with pytest.raises(
        ScenarioError, match=r"would need a step .*or a mass that stays \(payload\.mass_change\.factor = 1\)"
    ):
        World(paper.replace({**change(3.0), "payload.bending_stiffness": 1e12}))


def test_what_needs_a_constant_mass_refuses_a_changing_one_or_says_so():
    from flexlab.gym_environment.worlds import Settings, WorldBatch

    filled = load_preset("paper").replace(change(3.0))
    with pytest.raises(StudyError, match=r"payload\.mass_change\.factor = 3 cannot be used in the environment"):
        WorldBatch(Settings(scenario=filled), 1)
    assert "So is the change of the payload's mass." in make_bodies(filled).about()
    assert "mass." not in make_bodies(load_preset("paper")).about()
    fine = World(load_preset("paper").replace({**change(3.0), "payload.element_count": 24}))
    assert "a mass that stays (payload.mass_change.factor = 1)" in fine.pace_warning
