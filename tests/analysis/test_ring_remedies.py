"""From a tap to a shaper and a gain: the ring is found, remedies are offered, and they help."""

from dataclasses import replace

import numpy as np
import pytest

import flexlab
from flexlab.analysis.identification.estimates import Estimate
from flexlab.analysis.identification.free_ring import recent_ring
from flexlab.analysis.identification.remedies import remedies
from flexlab.analysis.identification.ring import fit_ring
from flexlab.analysis.modes import modes
from flexlab.errors import StudyError
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.commands import ChangeScenario, Pull, SetSpeed, Tap
from flexlab.sim.snapshot import Event

TAP = Tap(0.0, (0.0, 0.05))


@pytest.fixture(scope="module")
def standing() -> Scenario:
    return load_preset("paper").replace({"trajectory.kind": "hold", "controller.kind": "vibration-damping"})


@pytest.fixture(scope="module")
def tapped(standing: Scenario) -> flexlab.Run:
    undamped = standing.replace({"controller.lateral_vibration_gain": 0.0})
    return flexlab.simulate(undamped, 0.6, commands=[(0.1, TAP)])


def test_the_ring_since_the_tap_gives_the_loops_first_mode(tapped: flexlab.Run):
    events = [Event(0.1, "Tap", TAP), Event(0.3, "Speed", SetSpeed(0.5))]
    time, signal, since = recent_ring(tapped, events)
    assert since == "the tap at t = 0.100 s"
    assert (time[0], time[-1]) == (pytest.approx(0.101), pytest.approx(0.6))
    found = fit_ring(time, signal).first
    beams = [pole for pole, of in zip(*_poles(tapped.scenario), strict=True) if of == "beam mode 1" and pole.imag > 0]
    assert found.frequency.value == pytest.approx(abs(beams[0]) / (2 * np.pi), rel=0.01)
    until_change = recent_ring(tapped, [*events, Event(0.4, "Gain", ChangeScenario({"gravity": 1.0}))])[0]
    assert until_change[-1] == pytest.approx(0.4)


def _poles(scenario: Scenario) -> tuple:
    found = modes(scenario)
    return found.poles, found.pole_origin


def test_without_a_free_ring_the_error_says_what_to_do(tapped: flexlab.Run):
    with pytest.raises(StudyError, match="tap the beam"):
        recent_ring(tapped, [])
    with pytest.raises(StudyError, match="let go"):
        recent_ring(tapped, [Event(0.1, "Tap", TAP), Event(0.2, "Pull", Pull(0.0, (0.0, 1.0), 500.0))])
    released = [Event(0.2, "Pull", Pull(0.0, (0.0, 1.0), 500.0)), Event(0.3, "Let go", Pull(0.0, (0.0, 1.0), 0.0))]
    assert recent_ring(tapped, released)[2] == "the release at t = 0.300 s"
    time, signal, _ = recent_ring(tapped, [Event(0.1, "Tap", TAP)])
    fit = fit_ring(time[:30], signal[:30], 1)  # a period and a third
    assert not fit.first.frequency.identifiable
    assert remedies(fit, tapped.scenario) is None


def test_the_suggested_shaper_takes_away_nine_tenths_of_the_ring_after_a_stop():
    move = load_preset("paper").replace({"trajectory.kind": "bang-bang", "trajectory.duration": 0.3})
    run = flexlab.simulate(move, 0.8)
    time, signal, since = recent_ring(run, [])
    assert since in ("the stop at t = 0.299 s", "the stop at t = 0.300 s")
    fit = fit_ring(time, signal)
    offered = remedies(fit, move)
    assert offered is not None
    assert offered.suggested == "zv"
    for share, name in ((1.1, "zvd"), (1.17, "ei-shaper"), (1.4, "ei-shaper")):
        uncertain = replace(fit.first.frequency, high=share * fit.first.frequency.value)
        rough = remedies(replace(fit, modes=(replace(fit.first, frequency=uncertain),)), move)
        assert rough is not None
        assert rough.suggested == name, "its band holds the whole interval, if any does"
    assert [one.band for one in offered.shapers] == pytest.approx([0.032, 0.144, 0.20], abs=1e-3)
    shaped = flexlab.simulate(move.replace(offered.changes(offered.suggested)), 0.8)
    assert shaped.metrics.residual_vibration[0] < 0.1 * run.metrics.residual_vibration[0]


def test_the_suggested_gain_gives_the_damping_that_it_promises(standing: Scenario, tapped: flexlab.Run):
    time, signal, _ = recent_ring(tapped, [Event(0.1, "Tap", TAP)])
    offered = remedies(fit_ring(time, signal), standing)
    assert offered is not None
    assert offered.gain_field == "lateral_vibration_gain"
    damped = flexlab.simulate(
        standing.replace({"controller.lateral_vibration_gain": offered.gain}), 0.3, commands=[(0.1, TAP)]
    )
    ratio = fit_ring(*recent_ring(damped, [Event(0.1, "Tap", TAP)])[:2]).first.damping_ratio
    assert ratio.value == pytest.approx(0.1, rel=0.15)
    fit = fit_ring(time, signal)
    own = modes(standing)
    second, zeta = (Estimate(each[1], each[1], each[1], "") for each in (own.frequency, own.damping_ratio))
    turning = replace(fit.first, frequency=second, damping_ratio=zeta)
    offered = remedies(replace(fit, modes=(turning,)), standing)
    assert offered is not None
    assert offered.gain_field == "angular_vibration_gain"
    found = modes(standing.replace({"controller.angular_vibration_gain": offered.gain}))
    zetas = dict(zip(found.pole_origin, found.pole_damping_ratio, strict=True))
    assert zetas["beam mode 2"] == pytest.approx(0.1, rel=0.15)
