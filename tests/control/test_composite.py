"""Composite control: any law plus active damping of the beam from measured or estimated rates, and what it achieves."""

import numpy as np
import pytest

from flexlab.analysis.metrics.run_metrics import run_metrics
from flexlab.control.law import law_of, laws
from flexlab.control.observers.believed_plant import believed_plant
from flexlab.errors import ScenarioError
from flexlab.lab.panel.sections import entries
from flexlab.presets import load_preset
from flexlab.scenario import parse_scenario
from flexlab.sim.commands import ChangeScenario, Tap
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

COMPOSITE = {"controller.kind": "composite"}
CLOCK = {"controller.control_period": 1e-3, "controller.input_delay": 1, "controller.sensor_noise.strain": 1e-6}
KALMAN = {**COMPOSITE, **CLOCK, "controller.observer.kind": "kalman"}
FINE = {"payload.element_count": 8, "payload.damping.kind": "modal", "payload.damping.ratio": 1e-3}
HELD = {"trajectory.amplitude": (0.0, 0.0, 0.0)}
SIMPLE = [kind for kind, law in laws().items() if law.for_settings is None]


def same(one: Run, other: Run) -> bool:
    return one.pose.tobytes() == other.pose.tobytes() and one.joint_torque.tobytes() == other.joint_torque.tobytes()


@pytest.mark.parametrize("period", [None, 0.001])
def test_with_the_papers_law_and_measured_rates_it_is_vibration_damping(period: float | None):
    damped = load_preset("vibration-damping").replace({"controller.control_period": period})
    gains = {f"controller.{axis}_vibration_gain": value for axis, value in (("lateral", 80.0), ("angular", 300.0))}
    damped = damped.replace(gains)
    assert same(simulate(damped, 0.1), simulate(damped.replace({**COMPOSITE, **gains}), 0.1))


@pytest.mark.parametrize("kind", SIMPLE)
def test_without_vibration_gains_it_equals_its_slow_part(kind: str):
    """Motion, memory and the law's own signals are the same, whatever law is the slow part."""
    alone = load_preset("paper").replace({"controller.kind": kind, "gravity": 9.81})
    both = alone.replace({**COMPOSITE, "controller.slow.kind": kind, "controller.lateral_vibration_gain": 0.0})
    one, other = simulate(alone, 0.1), simulate(both, 0.1)
    assert same(one, other)
    assert list(one.own) == list(other.own)
    assert law_of(both.controller).memory == law_of(alone.controller).memory


def test_the_slow_part_is_no_composite_law_and_its_gains_are_checked():
    with pytest.raises(ScenarioError, match=r"controller\.slow\.kind = .* is not one of .*'adaptive-sliding-mode'"):
        parse_scenario({"controller": {"kind": "composite", "slow": {"kind": "composite"}}})
    with pytest.raises(ScenarioError, match=r"controller\.slow\.feedback_gain = -1 .* is outside the allowed range"):
        parse_scenario(
            {"controller": {"kind": "composite", "slow": {"kind": "adaptive-sliding-mode", "feedback_gain": -1}}}
        )


def test_the_screen_has_the_sliders_of_its_parts():
    scenario = load_preset("paper").replace({**KALMAN, "controller.slow.kind": "pd"})
    paths = [entry.path for entry in entries(scenario, "controller")]
    assert "controller.slow.position_gain" in paths
    assert "controller.lateral_vibration_gain" in paths
    assert "controller.observer.observer_modes" in paths


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({**KALMAN, "controller.control_period": None, "controller.input_delay": 0, "controller.sensor_noise": {}},
         r"give the control period \(controller\.control_period\) a value in s, or choose the observer measured"),
        ({**KALMAN, "controller.observer.gauges": ()}, r"controller\.observer\.gauges = \(\) needs 1 to 8 numbers"),
        ({**KALMAN, "controller.observer.gauges": (0.7,)}, r"controller\.observer\.gauges .* outside the allowed range"),
    ],
)  # fmt: skip
def test_observer_settings_that_do_not_fit_are_refused_in_a_sentence(change: dict, sentence: str):
    with pytest.raises(ScenarioError, match=sentence):
        load_preset("paper").replace(change)


def test_more_modes_than_the_mesh_has_are_refused_in_a_sentence():
    with pytest.raises(ScenarioError, match=r"observer_modes = 5 is more than the 4 modes of 2 pinned-pinned elements"):
        World(load_preset("paper").replace({**KALMAN, "controller.observer.observer_modes": 5}))


def test_a_filter_without_a_steady_gain_is_refused_in_a_sentence():
    """Growing modes that no sensor sees: no scenario has them, because its beam is damped."""
    scenario = load_preset("paper").replace(KALMAN)
    observer = scenario.controller.observer
    plant = believed_plant(scenario, observer.observer_modes, observer.gauges)
    unseen, growing = plant._replace(strain=np.zeros_like(plant.strain)), 1.1 * np.eye(2 * len(plant.mass))
    with pytest.raises(ScenarioError, match=r"controller\.observer: no steady gain is found for \d modes"):
        observer.gain(scenario, unseen, growing, np.eye(len(growing), len(plant.mass)))


def test_a_change_of_law_in_motion_keeps_the_bound_estimates_and_starts_the_observer():
    world = World(load_preset("paper").replace(CLOCK))
    world.advance(200)
    before = world.observe()
    world.apply(ChangeScenario({"controller.kind": "composite"}))
    np.testing.assert_array_equal(world.observe().bound_estimates, before.bound_estimates)
    torque = world.advance(3).joint_torque
    world.apply(ChangeScenario({"controller.observer.kind": "kalman"}))
    later = world.advance(3).joint_torque
    # The torques do not jump: the laws differ only by the damping.
    assert np.abs(later[0] - torque[-1]).max() < 0.2 * np.abs(torque).max()
    world.apply(ChangeScenario({"controller.observer.observer_modes": 2}))
    world.apply(ChangeScenario({"controller.slow.kind": "pd"}))
    world.apply(ChangeScenario({"trajectory.center": (0.0, 0.7, 0.0)}))
    assert len(world.advance(20)) == 20


def test_it_continues_bit_for_bit_from_a_saved_state():
    one, other = (World(load_preset("paper").replace(KALMAN)) for _ in range(2))
    one.advance(37)
    other.restore(one.state())
    assert one.advance_rows(20).tobytes() == other.advance_rows(20).tobytes()


def peak(run: Run, start: float, stop: float = np.inf) -> float:
    """Largest vibration, m."""
    return float(np.abs(run.vibration[(run.time >= start) & (run.time <= stop)]).max())


def test_on_the_papers_sine_free_vibration_ends_four_times_sooner_at_no_larger_error():
    """B1: below 1 % of its peak after 0.1 s instead of 0.44 s (`settling_time`), with a slow part of Λ = 70 1/s.

    With the paper's Λ = 50 1/s it ends 3.6 times sooner: the motion still catches up with its path and bends the beam.
    """
    paper = load_preset("paper")
    gains = {"controller.lateral_vibration_gain": 105.0, "controller.slow.sliding_slope": 70.0}
    plain, damped = simulate(paper, 1.5), simulate(paper.replace({**COMPOSITE, **gains}), 1.5)
    assert run_metrics(damped, (0, 1.5)).settling_time < run_metrics(plain, (0, 1.5)).settling_time / 4.4
    error, before = (np.abs(run.tracking_error).max(axis=0) for run in (damped, plain))
    assert np.all(error < before)


def test_a_tap_at_mid_span_is_gone_after_a_fifth_of_a_second():
    """B3: over a thousand times smaller than under the paper's law, which has hardly damped it by then."""
    held = load_preset("paper").replace(HELD)
    tap = [(0.0, Tap(0.0, (0.0, 0.2)))]
    plain, damped = simulate(held, 0.5, 0.001, tap), simulate(held.replace(COMPOSITE), 0.5, 0.001, tap)
    assert peak(plain, 0.2) > 1000 * peak(damped, 0.2)


LQR = {**CLOCK, "controller.kind": "lqr"}


@pytest.mark.parametrize(
    ("plant", "law", "times"), [({}, COMPOSITE, 40), (FINE, COMPOSITE, 30), (FINE, KALMAN, 50), (FINE, LQR, 40)]
)
def test_little_vibration_is_left_after_a_rest_to_rest_motion_of_a_soft_beam(plant: dict, law: dict, times: float):
    """B2: 0.2 m in 0.5 s with EI = 10 N·m²; the vibration 0.2 s after the stop is compared with the paper's law.

    The slow part must be slow compared with 14 Hz: Λ = 30 1/s. On the fine beam, the rates are measured in continuous time, or
    three modes are estimated from noisy gauges at 1 kHz, one sample late; the linear-quadratic regulator has the same clock.
    """
    soft = load_preset("paper").replace({**plant, "payload.bending_stiffness": 10.0, "trajectory.kind": "rest-to-rest"})
    slow = {"controller.slow.sliding_slope": 30.0, "controller.lateral_vibration_gain": 60.0}
    plain, damped = (
        simulate(soft.replace({**each, **(slow if "composite" in each.values() else {})}), 1.0) for each in ({}, law)
    )
    assert peak(plain, 0.7) > times * peak(damped, 0.7)


def test_the_damping_survives_a_clock_a_delay_and_noisy_gauges():
    """1 kHz, one sample late, strain noise of 1e-6; three of the sixteen modes of a hardly damped beam are estimated."""
    paper = load_preset("paper").replace(FINE)
    plain, damped = simulate(paper, 3.0), simulate(paper.replace(KALMAN), 3.0)
    assert damped.status == "finished"
    assert np.abs(damped.vibration[-500:]).max() < 5e-6
    assert run_metrics(damped, (0, 3)).settling_time < 0.15
    assert peak(plain, 0.5) > 0.2 * peak(plain, 0)
    error, before = (np.abs(run.tracking_error).max(axis=0) for run in (damped, plain))
    assert np.all(error < 1.05 * before)
