"""Conditions of the laws: their sentences state the right numbers, and runs do what they predict."""

import re
from pathlib import Path

import numpy as np
import pytest
from own_law_text import PD

import flexlab
from flexlab.analysis.law_conditions import circumstances, law_conditions
from flexlab.analysis.modes import modes
from flexlab.control.law import laws
from flexlab.control.motion import poses
from flexlab.lab.mode_computation import ModeStudy
from flexlab.lab.panel.readouts import conditions_html
from flexlab.lab.plots import tabs
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.assembly import build_system
from flexlab.sim.build import build_beam
from flexlab.sim.simulate import simulate
from flexlab.sim.step_rates import control_rate
from flexlab.sim.target import build_trajectory


def named(scenario: Scenario, start: str):
    """The condition that begins with `start`."""
    (found,) = [condition for condition in law_conditions(scenario) if condition.sentence.startswith(start)]
    return found


def test_the_beams_reaction_that_the_law_does_not_know_acts_across_the_beam():
    """Ā leaves out what the beam's first modes carry: Ψ = (κ terms) ẍ_d, at most 0.81 of m ẍ_d, and none along the beam."""
    around = circumstances(load_preset("paper"))
    angle = around.path.desired[:, 0, 2]
    along = around.reaction[:, 0] * np.cos(angle) + around.reaction[:, 1] * np.sin(angle)
    np.testing.assert_allclose(along, 0, atol=1e-12)
    assert around.largest_reaction == pytest.approx(8.6, abs=0.1)


@pytest.mark.parametrize("kind", ["rest-to-rest", "bang-bang", "waypoints"])
def test_a_path_that_begins_later_is_judged_by_its_own_motion(kind: str):
    """A path chosen in mid-run begins then: the conditions looked at the rest before it, and promised ‖Ψ‖ = 0 N."""
    path = load_preset("paper").replace({"trajectory.kind": kind})
    at_once, later = (circumstances(path.replace({"trajectory.start": start})) for start in (0.0, 30.0))
    assert at_once.largest_reaction > 2.0
    np.testing.assert_allclose(later.reaction, at_once.reaction, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "size", "rate"),
    [
        ({"trajectory.frequency": (0.25, 4.0, 1.0), "trajectory.amplitude": 0.05}, 29.15, 732.7),
        ({"trajectory.smooth_start": 1.0}, 8.592, 48.77),
        (
            {"trajectory.kind": "waypoints", "trajectory.jerk_limit": 1000.0, "trajectory.acceleration_limit": 10.0},
            None,
            None,
        ),
        ({"trajectory.kind": "bang-bang"}, 2.954, np.inf),
        ({"trajectory.kind": "bang-bang", "trajectory.shaper": "zv"}, None, np.inf),
        ({"trajectory.kind": "hold"}, 0.0, 0.0),
    ],
)
def test_the_beams_reaction_is_the_largest_on_the_whole_path(changes: dict, size: float | None, rate: float | None):
    """y at 4 Hz was seen 32 times in 4 s, at rest each time: 0.033 N, as was a path only during its smooth start."""
    around = circumstances(load_preset("paper").replace(changes))
    beam, motion = build_beam(around.scenario.payload).matrices, build_trajectory(around.scenario)
    desired = poses(motion, np.linspace(0, around.scenario.trajectory.slowest_period + 1.0, 40001))
    angle, asked = desired[:, 0, 2], desired[:, 2]
    # The paper's beam is symmetric: hᵀM_q⁻¹g = 0.
    across = beam.h @ np.linalg.solve(beam.M_q, beam.h) * (asked[:, 1] * np.cos(angle) - asked[:, 0] * np.sin(angle))
    turning = beam.g @ np.linalg.solve(beam.M_q, beam.g) * asked[:, 2]
    force = np.stack([-np.sin(angle) * across, np.cos(angle) * across, turning], axis=1)
    assert around.largest_reaction == pytest.approx(np.linalg.norm(force, axis=1).max(), rel=2e-3)
    assert size is None or around.largest_reaction == pytest.approx(size, rel=1e-3)
    if rate is None:
        step = around.scenario.trajectory.slowest_period + 1.0
        rate = float(np.linalg.norm(np.diff(force, axis=0), axis=1).max() / (step / 40000))
    assert around.largest_reaction_rate == pytest.approx(rate, rel=5e-3)


@pytest.mark.parametrize("frequency", [(0.25, 4.0, 1.0), (0.05, 5.0, 0.05)])
@pytest.mark.parametrize("kind", ["joint-pd", "sliding-mode"])
def test_the_fastest_rate_of_a_law_is_that_of_the_whole_path(kind: str, frequency: tuple[float, float, float]):
    """Only 16 poses of the fastest period were looked at: λ of joint-pd was 777 1/s instead of 837 1/s."""
    scenario = load_preset("paper").replace({"controller.kind": kind, "trajectory.frequency": frequency})
    around, system = circumstances(scenario), build_system(scenario, build_beam(scenario.payload))
    times = np.linspace(0.0, scenario.trajectory.slowest_period, 50_000)
    found = control_rate(system, np.ascontiguousarray(poses(system.trajectory, times)[:, 0]))
    assert around.fastest_rate == pytest.approx(found, rel=2e-4)


def test_no_gain_of_super_twisting_is_enough_where_the_acceleration_jumps():
    """k2 = 200 N/s was said to exceed 189 N/s, the jump over the time between two of 32 instants."""
    scenario = load_preset("paper").replace({"controller.kind": "super-twisting", "trajectory.kind": "bang-bang"})
    condition = named(scenario, "k2 > δ")
    assert not condition.met
    assert "jumps" in condition.sentence


def test_the_condition_on_feedback_predicts_whether_s_stays_in_the_boundary_layer():
    """K ε ≥ ‖Ψ‖ predicts whether ‖s‖ stays inside after the start; it does in one of the two presets."""
    for name, met in (("paper", True), ("weak-feedback", False)):
        scenario = load_preset(name)
        condition = named(scenario, "‖Ψ‖ ≤ K ε")
        assert condition.met == met
        run = simulate(scenario, 3.0)
        size = np.linalg.norm(run.sliding_variable[run.time > 2.0], axis=1).max()
        assert (size <= scenario.controller.boundary_layer) == met
        predicted = float(re.findall(r"‖s‖ = ([\d.]+)", condition.sentence)[0])
        assert size < predicted * 1.1


@pytest.mark.parametrize(("bound", "met"), [(30.0, True), (5.0, False)])
def test_a_constant_bound_has_to_exceed_the_beams_reaction(bound: float, met: bool):
    scenario = load_preset("paper").replace({"controller.kind": "sliding-mode", "controller.bound": bound})
    assert named(scenario, "ρ̂ ≥ ‖Ψ‖").met == met


@pytest.mark.parametrize(("delay", "ratio"), [(0, 0.001), (1, 0.0), (1, 0.02), (2, 0.001)])
def test_the_condition_on_late_torques_names_the_mode_that_grows(delay: int, ratio: float):
    """It is met if the sampled poles are stable; otherwise it states their growth to 10 % (2.65 1/s at 400 Hz)."""
    changes = {
        "payload.element_count": 8,
        "payload.damping": {"kind": "modal", "ratio": ratio},
        "controller.control_period": 1e-3,
        "controller.input_delay": delay,
        "controller.lateral_vibration_gain": 100.0,
    }
    scenario = load_preset("vibration-damping").replace(changes)
    condition, found = named(scenario, "f < 1/(4 (d + ½) T_c)"), modes(scenario)
    assert condition.met == (not found.unstable)
    if not condition.met:
        frequency, growth = re.findall(r"([\d.]+) Hz grows at ([\d.]+) 1/s", condition.sentence)[0]
        assert float(growth) == pytest.approx(found.growth, rel=0.1)
        if delay == 1:
            assert "167 Hz" in condition.sentence
            assert float(frequency) == pytest.approx(400, abs=1)


def test_super_twisting_needs_gains_above_the_change_of_the_reaction():
    base = load_preset("paper").replace({"controller.kind": "super-twisting"})
    assert [condition.met for condition in law_conditions(base)] == [True, True, True]
    weak = base.replace({"controller.integral_gain": 40.0})
    assert [condition.met for condition in law_conditions(weak)][:2] == [False, False]


def test_only_a_path_that_moves_tells_masses_apart():
    """Of the 8 masses of two arms and payload, 7 combinations can be identified: the grips are part of one rigid body."""
    moving = load_preset("paper").replace({"controller.kind": "regressor-adaptive"})
    resting = moving.replace({"trajectory.amplitude": (0.0, 0.0, 0.0)})
    for scenario, told in ((moving, 7), (resting, 0)):
        condition = named(scenario, "Y rich")
        assert condition.met == (told == 7)
        assert f"identifies {told} of the 7 " in condition.sentence


@pytest.mark.parametrize(("period", "met"), [(0.002, True), (0.05, False)])
def test_the_condition_on_the_control_period_predicts_whether_the_run_ends_early(period: float, met: bool):
    """The run ends early if λ T_c is beyond its limit."""
    scenario = load_preset("paper").replace({"controller.control_period": period})
    assert named(scenario, "λ T_c").met == met
    assert (simulate(scenario, 2.0).status == "finished") == met


@pytest.mark.parametrize("kind", laws())
def test_every_law_says_what_it_needs_and_the_panel_shows_it(kind: str):
    study = ModeStudy()
    clock = {"controller.control_period": 0.001} if kind == "lqr" else {}
    study.ask(load_preset("paper").replace({"controller.kind": kind, **clock}))
    study.stop()
    text = conditions_html(study.conditions)
    assert text.count("<b>met</b>") + text.count("<b>not met</b>") == len(study.conditions)
    assert (len(study.conditions) > 0) == laws()[kind].drives
    assert "nan" not in text
    assert not re.search(r"\d (N|1/s|Hz)\b", text), "no line breaks between a number and its unit"


def test_a_law_in_python_states_no_rate_and_no_condition_on_it(tmp_path: Path):
    """The lab said that the loop moves at 0 1/s and meets both conditions."""
    (tmp_path / "own_pd.py").write_text(PD, encoding="utf-8")
    run = flexlab.simulate("paper", 0.01, law=tmp_path / "own_pd.py")
    assert law_conditions(run.scenario) == ()


def test_the_plot_of_the_internal_force_shows_the_wanted_one():
    scenario = load_preset("paper")
    assert tabs(scenario)["Motion"][2].limits == ()
    (level,) = tabs(scenario.replace({"controller.wanted_internal_force": -40.0}))["Motion"][2].limits
    assert (level.label, level.value) == ("wanted F_d (N)", 40.0)
