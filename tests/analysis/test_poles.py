"""Poles against the simulation itself: differences over one control period, growth rates, rest points and stability."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from reference.linear import open_loop_matrices

import flexlab
from flexlab.analysis.linearization import Linearization
from flexlab.analysis.modes import Modes, fastest_growth, modes
from flexlab.analysis.stability import NEUTRAL, _deviations, find_disk_margin, find_poles, loop_map
from flexlab.errors import StudyError
from flexlab.physics.plant import DISSIPATED, ETA, WORK
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

HELD = {"trajectory.amplitude": (0.0, 0.0, 0.0)}


def fine(n: int = 8, period: float | None = 1e-3, delay: int = 1, **changes) -> Scenario:
    """Active damping, k_v = 100, of an undamped beam of n elements that holds its pose."""
    return load_preset("vibration-damping").replace(
        {
            **HELD,
            "payload.element_count": n,
            "payload.damping.kind": "modal",
            "payload.damping.ratio": 0.0,
            "controller.control_period": period,
            "controller.input_delay": delay,
            **changes,
        }
    )


def start_in(scenario: Scenario, weights: np.ndarray, size: float = 1e-6) -> Scenario:
    """Return the scenario with a little of each mode in its initial state."""
    q = modes(scenario).shape[:, : len(weights)] @ weights
    return scenario.replace({"initial.beam_coordinates": tuple(size * q), "initial.pose_rate": (0.0, 0.0, 0.0)})


def linear_of(found: Modes) -> Linearization:
    assert found.linearization is not None
    return found.linearization


def test_delayed_rate_feedback_feeds_the_third_mode():
    """A continuous analysis calls this loop stable, but the mode at 400 Hz grows as fast as in the simulation."""
    scenario = fine()
    found = modes(scenario)
    row = found.pole_rows()[0]
    assert row.origin == "beam mode 3"
    assert row.frequency == pytest.approx(401, abs=1)
    assert row.rate == found.growth == pytest.approx(2.65, rel=0.05)
    assert found.unstable
    run = simulate(start_in(scenario, np.array([0.0, 0.0, 1.0])), 1.5)
    energy = run.kinetic_energy + run.elastic_energy
    measured = np.polyfit(run.time[500:], np.log(energy[500:]), 1)[0] / 2
    assert measured == pytest.approx(found.growth, rel=0.005)
    continuous = modes(fine(period=None, delay=0))
    assert not continuous.unstable
    assert np.abs(continuous.poles.real + 4.80).min() < 0.01


APART = (30.0, 45.0, 70.0)
"""Slopes that keep the poles apart: a repeated pole would be accurate to only half the digits."""
GAINS = {"controller.position_gain": (900.0, 1600.0, 2500.0), "controller.velocity_gain": (60.0, 90.0, 130.0)}
POSE_STEP, MOMENTUM_STEP, TORQUE_STEP = 1e-6, 1e-4, 1e-2
"""Steps in m, kg·m/s and N·m whose effects within a period are of similar size."""
LOOPS = [
    ("vibration-damping", 0, {"controller.sliding_slope": APART}),
    ("vibration-damping", 1, {"controller.sliding_slope": APART}),
    ("pd", 0, {"gravity": 9.81, "controller.model.linear_density_factor": 0.4}),
    ("computed-torque", 3, {"gravity": 9.81, "controller.model.linear_density_factor": 1.7, **GAINS}),
    ("none", 2, {}),
]


@pytest.mark.parametrize(("law", "delay", "changes"), LOOPS)
def test_the_loop_map_has_the_eigenvalues_of_one_simulated_period(law: str, delay: int, changes: dict):
    """The simulation of one control period is differentiated with respect to all states."""
    scenario = load_preset("vibration-damping").replace(
        {**HELD, "trajectory.center": (0.1, 0.7, 0.2), "controller.kind": law, **changes}
        | {"controller.control_period": 2e-3, "controller.input_delay": delay, "simulation.step": 1e-5}
    )
    found = modes(scenario)
    rest = linear_of(found).rest
    world = World(scenario.replace({"initial.pose": tuple(rest.motion.x)}), 2e-3)
    state, n = world.state(), len(rest.motion.eta)
    y = state.y.copy()
    first = ETA
    y[first : first + n] = rest.motion.eta
    line = np.broadcast_to(rest.torque.reshape(-1, 3), state.torque_line.shape).copy()
    index = np.r_[0:6, first : first + 2 * n]
    assert first > max(WORK, DISSIPATED)

    def advanced(step: np.ndarray) -> np.ndarray:
        moved, torques = y.copy(), line + TORQUE_STEP * step[len(index) :].reshape(line.shape)
        moved[index] += size * step[: len(index)]
        world.restore(replace(state, y=moved, torque_line=torques, held_torque=torques[0].copy()))
        world.advance(1)
        after = world.state()
        return np.concatenate([after.y[index] / size, after.torque_line.ravel() / TORQUE_STEP])

    size = np.repeat([POSE_STEP, MOMENTUM_STEP, POSE_STEP, MOMENTUM_STEP], [3, 3, n, n])
    unit = np.eye(len(index) + line.size)
    still = advanced(np.zeros(len(unit)))[: len(index)] * size
    assert np.abs(still - y[index]).max() < 1e-9
    simulated = np.linalg.eigvals(np.stack([(advanced(e) - advanced(-e)) / 2 for e in unit], axis=1))
    own = np.linalg.eigvals(loop_map(linear_of(found)))
    for z in own[np.abs(own) > 0.05]:
        assert np.abs(simulated - z).min() < (2e-4 if law == "none" else 1e-6)
    for z in simulated[np.abs(simulated) > 0.05]:
        assert np.abs(own - z).min() < (2e-4 if law == "none" else 1e-6)


def random_cell(seed: int) -> Scenario:
    """Random gain, period, delay, damping and mesh, with a little of every mode in the initial state."""
    rng = np.random.default_rng(seed)
    scenario = fine(
        n=int(rng.integers(2, 13)),
        period=float(rng.choice([2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3])),
        delay=int(rng.integers(0, 4)),
        **{
            "payload.damping.ratio": float(rng.choice([0.0005, 0.002, 0.005, 0.02])),
            "controller.lateral_vibration_gain": float(10 ** rng.uniform(0.5, 2.5)),
            "controller.angular_vibration_gain": float(rng.choice([0.0, 10 ** rng.uniform(2, 3.5)])),
            "controller.feedback_gain": float(10 ** rng.uniform(1.5, 3.3)),
        },
    )
    return start_in(scenario, rng.normal(size=4), 1e-7)


def grows(scenario: Scenario, growth: float) -> bool:
    """Whether the simulated energy grows, over the time that a rate of this size takes to show."""
    duration = min(40.0, 0.3 + 5 / abs(growth))
    run = simulate(scenario, duration)
    if run.status.failed:
        return True
    energy = run.kinetic_energy + run.elastic_energy
    half, part = len(energy) // 2, max(len(energy) // 10, 1)
    return bool(energy[-part:].mean() > energy[half - part : half].mean())


@pytest.mark.parametrize("seed", [1, 4, 6, 10, 13, 16])
def test_random_loops_are_stable_or_not_as_simulated(seed: int):
    scenario = random_cell(seed)
    found = modes(scenario)
    assert grows(scenario, found.growth) == found.unstable, str(found)


def sagging(**changes) -> Scenario:
    """A soft beam bent by its weight, with the axial load in its model."""
    return load_preset("paper").replace(
        {
            **HELD,
            "payload.bending_stiffness": 1.27,
            "payload.axial_load": "first-order",
            "payload.damping": {"kind": "modal", "ratio": 0.01},
            "gravity": 9.81,
            "controller.kind": "pd",
            **changes,
        }
    )


def test_a_sagging_beam_that_feels_its_axial_load_rings_as_its_poles_say():
    """The loop includes the effect of internal forces on a beam that is bent at rest; without it ζ was 0.026, not 0.0146."""
    scenario = sagging()
    found = modes(scenario)
    q = found.shape @ linear_of(found).rest.motion.eta + 1e-3 * found.shape[:, 0]
    run = flexlab.simulate(scenario.replace({"initial.beam_coordinates": tuple(q)}), 4.0, 0.002)
    ring = flexlab.fit(run, signal="midspan_deflection", start=0.5).ring.modes[0]
    row = next(row for row in found.pole_rows() if row.origin == "beam mode 1")
    assert row.frequency == pytest.approx(ring.frequency.value, rel=1e-4)
    assert row.damping_ratio == pytest.approx(ring.damping_ratio.value, rel=1e-3)


def test_a_sagging_beam_that_is_squeezed_rests_where_the_simulation_comes_to_rest():
    """Its bending enters the axial force, which softens it; the computed rest point was 3 % short."""
    scenario = sagging(**{"controller.wanted_internal_force": 30.0, "payload.damping.ratio": 0.2})
    found, run = modes(scenario), flexlab.simulate(scenario, 4.0, 0.01)
    q = found.shape @ linear_of(found).rest.motion.eta
    np.testing.assert_allclose(q, run.beam_coordinates[-1], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"controller.wanted_internal_force": 20.0, "joints.motor.time_constant": 0.01},
        {"controller.control_period": 2e-3, "controller.input_delay": 2},
        {"controller.control_period": 2e-3, "controller.input_delay": 1, "controller.kind": "lqr"},
    ],
    ids=["continuous", "late motors", "sampled", "observer"],
)
def test_poles_of_a_sagging_beam_are_those_of_the_linear_model(changes: dict):
    scenario = sagging(**changes)
    found, model = modes(scenario), flexlab.linearize(scenario, inputs="desired_pose")
    value, period = np.linalg.eigvals(model.A), scenario.controller.control_period
    poles = found.poles if period is None else np.exp(found.poles * period)
    for pole in poles[np.abs(poles) > 0.05]:
        assert np.abs(value - pole).min() < 1e-7 * (1 if period else abs(pole))
    assert found.disk_margin is not None


def test_an_observer_and_a_beam_pressed_by_its_law_rest_where_the_simulation_does():
    """Torques and bending were computed in turns, and thirty did not converge: a stable loop was called unstable."""
    scenario = sagging(**{"controller.control_period": 2e-3, "controller.input_delay": 1, "controller.kind": "lqr"})
    found, run = modes(scenario), simulate(scenario, 6.0)
    assert np.ptp(run.pose[-200:], axis=0).max() < 1e-9, "it rests"
    assert not found.unstable
    assert not found.note
    np.testing.assert_allclose(found.pose, run.pose[-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("force", [-20.0, 15.0])
@pytest.mark.parametrize("law", ["pd", "joint-pd", "sliding-mode", "disturbance-observer", "computed-torque"])
def test_a_pressed_or_pulled_beam_under_weight_rests_where_the_simulation_does(law: str, force: float):
    changes = {
        "payload.bending_stiffness": 4.0,
        "payload.damping.ratio": 0.05,
        "controller.wanted_internal_force": force,
    }
    scenario = sagging(**{"controller.kind": law, **changes})
    found, run = modes(scenario), simulate(scenario, 8.0)
    assert np.ptp(run.pose[-200:], axis=0).max() < 1e-9, "it rests"
    assert not found.unstable
    np.testing.assert_allclose(found.pose, run.pose[-1], rtol=0, atol=1e-9)


def test_a_wrong_mass_moves_the_rest_point_to_where_the_simulation_comes_to_rest():
    scenario = load_preset("gravity").replace(
        {**HELD, "controller.kind": "pd", "controller.model.linear_density_factor": 0.3}
    )
    found = modes(scenario)
    assert 1e-4 < scenario.trajectory.center[1] - found.pose[1] < 1e-2
    np.testing.assert_allclose(simulate(scenario, 5.0).pose[-1], found.pose, rtol=0, atol=1e-9)


def test_estimates_that_never_come_to_rest_get_a_note():
    """Under weight and with a wrong mass, b̂ grows for ever: the poles are those of the law at its start."""
    scenario = load_preset("gravity").replace({"controller.model.linear_density_factor": 0.5})
    found = modes(scenario)
    assert "never comes to rest" in found.note
    assert not found.unstable
    assert len(found.poles) == 2 * len(found.frequency) + 6


@pytest.mark.parametrize("slow", ["adaptive-sliding-mode", "regressor-adaptive"])
def test_estimates_that_nothing_changes_keep_their_start_while_an_observer_settles(slow: str):
    """Only the observer of a sagging beam starts wrong, but the poles assumed b̂ = 183 N or a mass of -5900 kg."""
    changes = {
        "controller.slow.kind": slow,
        "gravity": 9.81,
        "payload.bending_stiffness": 10.0,
        "trajectory.kind": "hold",
    }
    if slow == "regressor-adaptive":
        changes["controller.slow.initial_estimate_factor"] = 1.0
    scenario = load_preset("composite").replace(changes)
    found, run = linear_of(modes(scenario)), simulate(scenario, 2.0)
    rest, start = found.rest.memory, found.probe.start_memory
    kept = 3 if slow == "adaptive-sliding-mode" else 8
    np.testing.assert_array_equal(rest[:kept], start[:kept])
    last = run.bound_estimates[-1] if kept == 3 else run.link_mass_estimates[-1].ravel()
    np.testing.assert_allclose(rest[:kept][-len(last) :], last, rtol=1e-2, atol=1e-2)


def test_a_loop_without_a_rest_point_has_modes_no_poles_and_a_note():
    """Without motors, nothing holds the weight."""
    found = modes(load_preset("gravity").replace({"controller.kind": "none"}))
    assert len(found.frequency) == 4
    assert len(found.poles) == 0
    assert not found.unstable
    assert "no rest point" in found.note
    assert found.note in str(found)
    assert found.disk_margin is None


def test_torque_limits_and_noise_do_not_change_the_poles():
    plain, rough = (
        modes(fine(2, **more))
        for more in ({}, {"controller.torque_limit": (1.0, 1.0, 1.0), "controller.sensor_noise.pose": (0.1, 0.1, 0.1)})
    )
    np.testing.assert_array_equal(plain.poles, rough.poles)


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_poles_are_those_of_an_independent_linearisation(gravity: float):
    """Masses, forces and torques from positions of points (`reference.linear`); the law by hand: u = Ḡ - P e - D ė."""
    scenario = load_preset("gravity").replace(
        {**HELD, "trajectory.center": (0.05, 0.7, 0.1), "gravity": gravity}
        | {"controller.kind": "pd", "payload.element_count": 3, "payload.damping.coefficient": 0.02}
    )
    found = modes(scenario)
    law, rest = scenario.controller, linear_of(found).rest
    q = linear_of(found).probe.beam.modes.V @ rest.motion.eta
    M, C, K, weight_slope = open_loop_matrices(scenario, np.concatenate([rest.motion.x, q]))
    # The law carries the arms' weight at every pose, which held torques would not: the slope of the weight drops out of K.
    K[:3, :3] += np.diag(np.full(3, law.position_gain)) - weight_slope
    C[:3, :3] += np.diag(np.full(3, law.velocity_gain))
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [np.linalg.solve(M, -K), np.linalg.solve(M, -C)]])
    expected = np.linalg.eigvals(A)
    assert len(expected) == len(found.poles)
    for pole in found.poles:
        assert np.abs(expected - pole).min() < 1e-6 * abs(pole)


def test_modes_print_as_a_table():
    text = str(modes(fine()))
    assert "Poles of the sampled loop, sampled at 1 ms, torques 1 sample late" in text
    assert "GROWS   beam mode 3" in text
    assert "UNSTABLE: small motions grow at 2.65 1/s." in text
    assert "44.43" in text
    quiet = str(modes(load_preset("paper")))
    assert "Poles of the continuous loop" in quiet
    assert "GROWS" not in quiet
    assert "45.54" in quiet
    assert re.search(r"^ +1 +44\.60 .* 80\.9 +0\.0$", quiet, re.MULTILINE), "8/π² of its mass moves sideways"
    assert re.search(r"^ +2 +197\.25 .* 0\.0 +62\.5$", quiet, re.MULTILINE), "6/π² of its inertia turns"


def test_all_growing_poles_are_in_the_table():
    """It ended after sixteen, and said that none of the others grows."""
    gains = {"controller.lateral_vibration_gain": 1000.0, "controller.angular_vibration_gain": 3e4}
    found = modes(fine().replace({"payload.element_count": 20, **gains}))
    growing = sum(row.rate > NEUTRAL for row in found.pole_rows())
    assert str(found).count("GROWS") == growing > 16
    assert f"… and {len(found.pole_rows()) - growing} more, none of which grows" in str(found)


@pytest.mark.parametrize("pose", [(0.0, 9.0, 0.0), (0.0, float("nan"), 0.0), (1.0, 2.0), "up"])
def test_poses_out_of_reach_are_refused_in_a_sentence(pose):
    with pytest.raises(StudyError, match=r"reach|three numbers"):
        modes(load_preset("paper"), pose)


@pytest.mark.parametrize(
    "changes",
    [
        {"controller.control_period": 2e-3, "controller.input_delay": 1},
        {"payload.bending_stiffness": 500.0, "payload.element_count": 3, "payload.damping": {"kind": "modal", "ratio": 0.02},
         "controller.kind": "vibration-damping", "controller.control_period": 1e-3, "controller.input_delay": 1,
         "controller.lateral_vibration_gain": 60.0, "controller.angular_vibration_gain": 30.0},
    ],
)  # fmt: skip
def test_motors_within_the_disk_margin_keep_the_loop_stable(changes: dict[str, Any]):
    """Each motor's gain at either end of its range; one complex factor for all motors up to the margin, but not beyond.

    The second loop's worst frequency lies between those of a coarse grid, which gave a margin that is 0.5 % too large.
    """
    found = modes(load_preset("paper").replace(changes))
    linear, margin = linear_of(found), found.disk_margin
    assert margin is not None

    def worst(factors: np.ndarray) -> float:
        motion, memory = linear.law.motion.astype(complex), linear.law.memory.astype(complex)
        count = linear.torque_count
        motion[:count] *= factors[:, None]
        memory[:count] *= factors[:, None]
        changed = linear._replace(law=linear.law._replace(motion=motion, memory=memory))
        return float(np.abs(np.linalg.eigvals(loop_map(changed))).max())

    rng = np.random.default_rng(3)
    low, high = margin.each.gain
    assert all(worst(rng.choice([low, high], linear.torque_count)) < 1 for _ in range(40))
    sizes = []
    for share in (0.9995, 1.0005):
        turns = share * margin.alike.alpha * np.exp(1j * np.linspace(0, np.pi, 500))
        sizes.append(max(worst(np.full(linear.torque_count, (1 + d / 2) / (1 - d / 2))) for d in turns))
    assert sizes[0] < 1 < sizes[1]


@pytest.mark.parametrize("name", ["gravity", "squeeze-until-it-buckles", "paper"])
def test_a_margin_that_is_least_at_rest_is_that_at_rest(name: str):
    """The slowest frequency that was looked at gave a margin 1.6e-4 too large."""
    found = modes(load_preset(name))
    at_rest = 1 / _deviations(linear_of(found), np.array([0.02]))[1, 0]
    assert found.disk_margin is not None
    assert found.disk_margin.each.alpha == pytest.approx(at_rest, rel=1e-5)


def test_an_unstable_loop_has_no_margin():
    margin = modes(fine()).disk_margin
    assert margin is not None
    assert margin.alike.alpha == margin.each.alpha == 0


def test_free_arms_have_six_neutral_poles_and_the_largest_margin():
    """With the motors off, the six poles of the pose are neutral, and no factor on a zero torque matters."""
    found = modes(load_preset("paper").replace({"controller.kind": "none"}))
    assert np.sum(np.abs(found.poles) < NEUTRAL) == 6
    assert find_poles(linear_of(found)).value.shape == found.poles.shape
    assert not found.unstable
    assert str(found).count("     –      –           0  stays   pose\n") == 6
    assert "at rest at (0, 0.75, 0) m, m, rad" in str(found)
    assert fastest_growth(found) == (0, pytest.approx(np.nan, nan_ok=True), 0, "pose")
    assert {row.verdict for row in found.pole_rows() if abs(row.rate) < NEUTRAL} == {"stays"}
    assert {row.verdict for row in found.pole_rows() if row.mode} == {"decays"}
    assert found.disk_margin is not None
    assert found.disk_margin.each.alpha == pytest.approx(2)


def test_rounding_errors_of_neutral_poles_change_no_disk_margin():
    """Four estimates of the law stay as they are. Their poles of 1e-15/s made 19° of a margin of 70° on some processors."""
    found = modes(load_preset("gravity").replace({"controller.kind": "regressor-adaptive"}))
    size = np.geomspace(1e-17, 1e-13, 9)
    margin = find_disk_margin(linear_of(found), np.concatenate([found.poles, size + 1j * size, size - 1j * size]))
    assert margin == found.disk_margin
    assert margin.alike.phase == pytest.approx(70.23, abs=0.01)


@pytest.mark.parametrize(
    ("position_gain", "velocity_gain"), [(3200.0, 80.0), (2500.0, 50 * np.sqrt(0.8)), (5000.0, 100.0)]
)
def test_a_pole_with_equal_parts_changes_no_disk_margin(position_gain: float, velocity_gain: float):
    """With ζ = 1/√2 or 1/√5, Im p - |Re p| or Im p - 2|Re p| is 1e-13/s: there, all digits are lost, and α was 5e-15."""
    law = {"controller.kind": "computed-torque", "controller.velocity_gain": velocity_gain}
    around = [
        modes(load_preset("paper").replace({**law, "controller.position_gain": share * position_gain})).disk_margin
        for share in (0.999, 1.0, 1.001)
    ]
    below, at, above = (margin.alike.alpha for margin in around if margin is not None)
    assert at == pytest.approx((below + above) / 2, rel=1e-5)


@pytest.mark.parametrize(("count", "boundary"), [(1, "pinned-pinned"), (2, "pinned-pinned"), (2, "clamped-clamped")])
@pytest.mark.parametrize("period", [None, 5e-4])
def test_an_undamped_beam_on_free_arms_neither_decays_nor_grows(count: int, boundary: str, period: float | None):
    """Rounding errors gave it a damping ratio of -9.17e-15 % and a growth of 5.6e-13 1/s, others on other processors.

    At a frequency that the loop shares with the arms and beam to the last bit, the margin was an error of LAPACK.
    """
    free = {"controller.kind": "none", "controller.control_period": period}
    beam = {
        "payload.element_count": count,
        "payload.boundary": boundary,
        "payload.damping": {"kind": "modal", "ratio": 0.0},
    }
    found = modes(load_preset("paper").replace({**free, **beam}))
    assert np.all(found.poles.real == 0)
    assert found.growth == 0
    assert {line.split()[1] for line in str(found).splitlines() if line.endswith("beam mode 1")} == {"0"}
    assert found.disk_margin is not None
    assert found.disk_margin.each.alpha == pytest.approx(2)


def test_rounding_errors_of_estimates_make_no_poles():
    """Of three estimates that rest, one or two were said to change by 5e-17, and the loop not to decay at all."""
    changes = {
        "controller.control_period": 1e-3, "trajectory.kind": "hold", "gravity": 10.1, "payload.boundary": "clamped-clamped",
        "payload.element_count": 5, "payload.linear_density": 0.4, "payload.length": 0.65,
    }  # fmt: skip
    for angle in (-0.4, -0.3, -0.2, 0.1, 0.2, 0.3, 0.4):
        found = modes(load_preset("paper").replace({**changes, "trajectory.pose": (-0.03, 0.86, angle)}))
        assert len(found.poles) == 2 * len(found.frequency) + 6
        assert found.growth < -1


def test_equal_real_poles_do_not_oscillate():
    """By rounding errors, some processors found a pair at 7.96 Hz with a damping ratio of 100 %."""
    found = modes(load_preset("soft-beam").replace({"controller.kind": "computed-torque"}))
    equal = found.poles[np.abs(found.poles + 50) < 1e-3]
    assert len(equal) == 2
    assert np.all(equal.imag == 0)
    assert [row.frequency for row in found.pole_rows() if abs(row.rate + 50) < 1e-3] == [0, 0]


def test_poles_of_compliant_grips_say_that_they_hold_for_rigid_grips():
    """Modes said "a stable loop" for a loop that ran away within 12 ms."""
    scenario = load_preset("paper").replace(
        {"grips.model": "compliant", "controller.control_period": 0.001, "controller.input_delay": 1}
    )
    assert simulate(scenario, 0.05).status == "diverged"
    found = modes(scenario)
    assert "The grips give way here (grips.model), but this holds for rigid grips" in str(found)
    assert repr(found).endswith("a stable loop, with rigid grips>")
    assert found.note in str(flexlab.linearize(scenario))
    assert "rigid" not in repr(modes("paper")) + str(modes("paper"))
    filled = load_preset("paper").replace({"payload.mass_change.factor": 3.0})
    assert (
        modes(filled).note == "The payload's mass changes (payload.mass_change): this holds for its mass at the start."
    )
    np.testing.assert_array_equal(modes(filled).poles, modes("paper").poles)
