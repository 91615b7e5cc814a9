"""Intervals of fits hold the truth as often as they claim, even where arms and a law carry the beam and its ring is not plain."""

import re
from typing import Any

import numpy as np
import pytest

import flexlab
from flexlab.analysis.identification.beam_parameters import first_mode
from flexlab.analysis.identification.ring import fit_ring
from flexlab.sim.commands import Tap

LAWS = (
    "adaptive-sliding-mode", "composite", "computed-torque", "disturbance-observer", "joint-pd", "lqr", "pd",
    "regressor-adaptive", "sliding-mode", "super-twisting", "vibration-damping",
)  # fmt: skip


def tapped_runs(seed: int) -> list[flexlab.Run]:
    """Two tapped runs of each law, with random stiffness, path, clock and tap."""
    rng, scenarios, commands = np.random.default_rng(seed), [], []
    for law in LAWS * 2:
        changes = {
            "controller.kind": law,
            "controller.control_period": 0.001 if law == "lqr" else (None, 0.001)[rng.integers(2)],
            "payload.bending_stiffness": float(np.exp(rng.uniform(np.log(30), np.log(300)))),
            "trajectory.kind": ("sine", "sine", "circle", "hold")[rng.integers(4)],
        }
        scenarios.append(flexlab.load_preset(("paper", "smooth-start", "gravity")[rng.integers(3)]).replace(changes))
        push = (rng.uniform(-0.1, 0.1), rng.choice([-1, 1]) * rng.uniform(0.05, 0.4))
        commands.append((rng.uniform(0.5, 1.0), Tap(float(rng.uniform(-0.1, 0.1)), (float(push[0]), float(push[1])))))
    return [
        flexlab.simulate(scenario, command[0] + 1.0, commands=[command], check=True)
        for scenario, command in zip(scenarios, commands, strict=True)
    ]


def test_at_least_nine_of_ten_intervals_hold_the_truth_under_any_law():
    """Intervals that counted noise alone held 70 % of the stiffnesses and 30 % of the frequencies; many were ±0.01 %."""
    held: dict[str, list[bool]] = {}
    for run in tapped_runs(2):
        fit = flexlab.fit(run)
        assert fit.beam is not None
        ring = fit.signal - fit.ring.background
        middle = fit.time[np.searchsorted(np.cumsum(ring**2), 0.5 * np.sum(ring**2))]
        x, y, angle = map(float, run.desired_pose[np.searchsorted(run.time, middle)])
        payload, (f, zeta) = run.scenario.payload, first_mode(run.scenario, True, (x, y, angle))
        for name, estimate, truth in (
            ("f1", fit.ring.first.frequency, f),
            ("ζ1", fit.ring.first.damping_ratio, zeta),
            ("EI", fit.beam.bending_stiffness, payload.bending_stiffness),
            ("damping", fit.beam.damping, payload.damping.coefficient),
        ):
            if estimate.identifiable:
                held.setdefault(name, []).append(estimate.low <= truth <= estimate.high)
    for name, each in held.items():
        assert np.mean(each) >= 0.9, name
    assert len(held["EI"]) >= 0.9 * len(LAWS) * 2


def test_a_higher_mode_is_not_taken_for_a_hidden_first_mode():
    """The first mode was left out because its interval was wide, and the second gave many times the stiffness."""
    scenario = flexlab.load_preset("smooth-start").replace(
        {
            "controller.kind": "lqr",
            "trajectory.kind": "hold",
            "payload.bending_stiffness": 31.2,
            "controller.control_period": 1e-3,
        }
    )
    for place in (-0.1, 0.03, 0.1):
        run = flexlab.simulate(scenario, 1.7, commands=[(0.7, Tap(place, (0.0, 0.3)))])
        found = flexlab.fit(run).beam
        assert found is not None
        stiffness = found.bending_stiffness
        assert not stiffness.identifiable or stiffness.low <= 31.2 <= stiffness.high


@pytest.mark.parametrize(
    ("period", "words"),
    [(0.02, {}), (0.001, {"end": 0.52}), (0.001, {"signal": "kinetic_energy"}), (0.001, {"signal": "total_energy"})],
)
def test_a_frequency_that_is_not_the_first_modes_gives_no_beam_parameters(period: float, words: dict[str, Any]):
    """For EI = 80, an aliased frequency gave 4.29 ± 0.003, the second mode alone 1878 ± 50, an energy 0.7 ± 0.1."""
    scenario = flexlab.load_preset("smooth-start").replace({"payload.bending_stiffness": 80.0})
    run = flexlab.simulate(scenario, 1.5, period, commands=[(0.5, Tap(0.05, (0.0, 0.3)))])
    found = flexlab.fit(run, **words).beam
    assert found is not None
    for estimate in (found.bending_stiffness, found.damping):
        assert not estimate.identifiable
    assert re.search(
        r"it rings at .* Hz, and the first mode of this run's loop is at 40\.\d* Hz|hold 1\.9 of its periods; 2 are needed",
        str(found.bending_stiffness),
    )


@pytest.mark.parametrize("elements", [2, 3, 8])
def test_modes_hidden_by_noise_are_not_listed_with_those_of_the_ring(elements: int):
    """Such modes only absorb what the fit of a ring in moving arms leaves; they are no modes of the beam."""
    scenario = flexlab.load_preset("smooth-start").replace({"payload.element_count": elements})
    fit = flexlab.fit(flexlab.simulate(scenario, 1.5, commands=[(0.5, Tap(0.05, (0.0, 0.3)))]))
    assert all(mode.frequency.identifiable for mode in fit.ring.modes)


@pytest.mark.parametrize("noise", [1e-3, 1e-2])
@pytest.mark.parametrize("zeta", [0.002, 0.01])
@pytest.mark.parametrize("rise", [0.3, 1.0])
def test_a_frequency_that_changes_is_told_and_widens_the_intervals(rise: float, zeta: float, noise: float):
    """Two modes were listed, at 43.97 ± 0.005 and 44.27 Hz or so, with damping ratios up to seven times the true one."""
    t = np.arange(1000) * 1e-3
    size, f = np.exp(-zeta * 2 * np.pi * 44 * t), 44 + rise * t
    phase = 2 * np.pi * (44 * t + rise * t**2 / 2)
    found = fit_ring(t, size * np.cos(phase + 0.4) + noise * np.random.default_rng(1).normal(size=len(t)))
    assert found.is_ring
    assert len(found.modes) == 1
    frequency, ratio = found.first.frequency, found.first.damping_ratio
    assert frequency.low < np.average(f, weights=size**2) < frequency.high
    assert ratio.low < zeta < ratio.high
    later = np.cumsum(size**2) > np.sum(size**2) / 2
    halves = [np.polyfit(t[part], phase[part], 1, w=size[part])[0] / (2 * np.pi) for part in (~later, later)]
    assert found.halves is not None
    assert found.halves == pytest.approx(halves, abs=0.05 * rise)
    assert found.change.startswith(
        f"The loudest mode rings at {found.halves[0]:.5g} Hz in the first half of its energy"
    )


def test_a_frequency_that_stays_is_not_said_to_change():
    """Whatever the noise, and beside another mode."""
    t = np.arange(1000) * 1e-3
    for seed in range(10):
        rng = np.random.default_rng(seed)
        signal = np.exp(-t) * np.cos(2 * np.pi * 44 * t) + 0.2 * np.exp(-3 * t) * np.cos(2 * np.pi * 177 * t)
        coloured = np.convolve(rng.normal(size=len(t)), np.exp(-np.arange(40) / 5))[: len(t)]
        assert fit_ring(t, signal + 0.02 * (coloured if seed % 2 else rng.normal(size=len(t)))).change == ""


@pytest.mark.parametrize("size", [0.05, 0.3, 2.0])
@pytest.mark.parametrize("kind", ["bend", "kink", "walk"])
def test_a_slow_drift_beside_a_ring_is_no_mode(kind: str, size: float):
    """It was listed as f1 = 3.2 Hz, 95 % within 3.1 to 3.3 Hz; a louder one was taken for the beam's mode."""
    t, rng = np.arange(1000) * 1e-3, np.random.default_rng(1)
    walk = np.convolve(np.cumsum(rng.normal(size=1200)), np.hanning(201) / 100, "valid")
    drift = {"bend": np.tanh(10 * t - 5), "kink": 2 * np.abs(t - 0.4), "walk": (walk - walk.mean()) / np.ptp(walk)}[
        kind
    ]
    found = fit_ring(t, np.exp(-1.4 * t) * np.cos(2 * np.pi * 44 * t) + size * drift + 3e-3 * rng.normal(size=len(t)))
    assert [mode.frequency.value for mode in found.modes] == pytest.approx([44.0], abs=0.01)
    assert found.first.frequency.low < 44.0006 < found.first.frequency.high
    assert np.std(found.background - size * drift + np.mean(size * drift - found.background)) < 0.1 * size


def test_no_line_of_white_noise_is_listed_beside_a_drift():
    """A line taken while the drift was not yet fitted well stayed: 1 of 7 fits had a mode at 22, 115 or 447 Hz."""
    t, u = np.arange(1000) * 1e-3, np.linspace(-1, 1, 1000)
    for seed in range(3):
        noise = 3e-3 * np.random.default_rng(seed).normal(size=len(t))
        found = fit_ring(t, np.exp(-1.4 * t) * np.cos(2 * np.pi * 44 * t) + 0.05 * (4 * u**3 - 3 * u) + noise)
        assert len(found.modes) == 1
