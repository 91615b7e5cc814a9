"""What the presets tell people to watch is what happens (three simulated seconds each)."""

import re

import numpy as np
import pytest
from preset_run import run

from flexlab.presets import load_preset, preset_names
from flexlab.sim.commands import ChangeScenario
from flexlab.sim.samples import Run
from flexlab.sim.simulate import simulate


def peak(run: Run, signal: np.ndarray, start: float, stop: float) -> np.ndarray:
    """Return the largest magnitude of a signal in a span of time."""
    return np.abs(signal[(run.time >= start) & (run.time <= stop)]).max(axis=0)


def frequency(run: Run, signal: np.ndarray, above: float) -> float:
    """Return the strongest frequency above a limit within the first 0.3 s, Hz."""
    part = signal[run.time < 0.3]
    spectrum = np.abs(np.fft.rfft((part - part.mean()) * np.hanning(len(part)), 1 << 15))
    hertz = np.fft.rfftfreq(1 << 15, 0.001)
    return float(hertz[np.argmax(np.where(hertz > above, spectrum, 0))])


def says(name: str, pattern: str) -> float:
    """Return the number that a preset's text gives, so that text and test cannot disagree."""
    found = re.search(pattern, load_preset(name).watch)
    assert found, pattern
    return float(found[1])


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_runs_to_its_end_with_a_beam_that_bends_little(name: str):
    result = run(name)
    assert result.status == "finished", result.status.text
    assert peak(result, result.midspan_deflection, 0, 3) < 0.05 * load_preset(name).payload.length


@pytest.mark.parametrize("name", [name for name in preset_names() if "a millimetre" in load_preset(name).watch])
def test_an_error_below_a_millimetre_is_kept_where_it_is_claimed(name: str):
    result = run(name)
    assert peak(result, result.tracking_error, 1, 3)[:2].max() < 1e-3


def test_paper_rings_at_first_and_then_follows_the_path():
    paper = run("paper")
    assert frequency(paper, paper.vibration, 10) == pytest.approx(says("paper", r"at (\S+) Hz"), rel=0.01)
    assert peak(paper, paper.vibration, 0.5, 3) < 0.01 * peak(paper, paper.vibration, 0, 0.1)
    largest = 1e3 * peak(paper, paper.midspan_deflection, 1, 3)
    assert largest == pytest.approx(says("paper", r"by (\S+) mm"), abs=0.005)


def test_smooth_start_hardly_vibrates():
    smooth, paper = run("smooth-start"), run("paper")
    assert 1e6 * peak(smooth, smooth.vibration, 0, 3) < says("smooth-start", r"under (\d+) micrometres")
    assert 1e3 * peak(paper, paper.vibration, 0, 0.5) == pytest.approx(
        says("smooth-start", r"reaches (\S+) mm"), abs=0.05
    )


def test_soft_beam_bends_by_a_centimetre():
    soft = run("soft-beam")
    assert 0.008 < peak(soft, soft.midspan_deflection, 0, 3) < 0.014
    assert peak(soft, soft.tracking_error, 0, 3)[:2].max() < 1e-3


def test_stiff_beam_tracks_like_the_paper():
    stiff, paper = run("stiff-beam"), run("paper")
    micrometres = says("stiff-beam", r"by (\S+) micrometres")
    assert 1e6 * peak(stiff, stiff.midspan_deflection, 1, 3) == pytest.approx(micrometres, abs=0.05)
    ratio = peak(stiff, stiff.tracking_error, 1, 3) / peak(paper, paper.tracking_error, 1, 3)
    assert np.abs(ratio - 1).max() < 0.01


def test_large_swing_is_wide_and_reachable():
    swing = run("large-swing")
    assert np.ptp(swing.pose[:, 0]) == pytest.approx(says("large-swing", r"(\S+) m wide"), abs=0.02)
    assert np.abs(swing.pose[:, 2]).max() == pytest.approx(says("large-swing", r"by (\S+) rad"), abs=0.02)
    scenario = load_preset("large-swing")
    wrist_offset = scenario.payload.length / 2 + scenario.left_arm.link_length[2]
    direction = np.stack([np.cos(swing.pose[:, 2]), np.sin(swing.pose[:, 2])], axis=1)
    distances = [
        np.linalg.norm(swing.pose[:, :2] + side * wrist_offset * direction - arm.base, axis=1)
        for side, arm in zip((-1, 1), scenario.arms, strict=True)
    ]
    assert np.max(distances) == pytest.approx(says("large-swing", r"as far as (\S+) m"), abs=0.01)


def test_slow_adaptation_changes_the_error_little():
    slow, paper = run("slow-adaptation"), run("paper")
    ratio = paper.bound_estimates[-1] / slow.bound_estimates[-1]
    assert np.all((ratio > 95) & (ratio < 105))
    change = peak(slow, slow.tracking_error, 1, 3) / peak(paper, paper.tracking_error, 1, 3) - 1
    assert 0.01 < np.abs(change).max() < 0.015


def test_composite_damps_almost_as_well_as_with_exact_rates_and_no_delay():
    scenario = load_preset("composite")
    assert scenario.controller.input_delay * scenario.controller.control_period == 0.001
    assert scenario.controller.sensor_noise.strain > 0
    kept = {"payload", "trajectory", "initial", "left_arm", "right_arm"}
    assert scenario.model_dump(include=kept) == load_preset("vibration-damping").model_dump(include=kept)
    composite, exact, paper = run("composite"), run("vibration-damping"), run("paper")
    later = [peak(each, each.vibration, 0.13, 0.4) for each in (composite, exact, paper)]
    assert later[0] < 1.2 * later[1] < 0.1 * later[2]


def test_lqr_lowers_error_and_ring_at_the_cost_of_torque():
    lqr, paper = run("lqr"), run("paper")
    assert peak(lqr, lqr.vibration, 0.1, 0.4) < 0.1 * peak(paper, paper.vibration, 0.1, 0.4)
    assert peak(lqr, lqr.tracking_error, 0, 3)[:2].max() < 0.7 * peak(paper, paper.tracking_error, 0, 3)[:2].max()
    assert np.abs(lqr.joint_torque).max() > 2 * np.abs(paper.joint_torque).max()


def test_gravity_sags_and_rings():
    gravity = run("gravity")
    payload = load_preset("gravity").payload
    sag = 5 * payload.linear_density * 9.81 * payload.length**4 / (384 * payload.bending_stiffness)
    assert 1e3 * sag == pytest.approx(says("gravity", r"sag of (\S+) mm"), abs=0.01)
    assert gravity.midspan_deflection[gravity.time >= 1].mean() == pytest.approx(-sag, rel=0.1)
    assert frequency(gravity, gravity.vibration, 5) == pytest.approx(says("gravity", r"rings at (\d+) Hz"), rel=0.05)
    assert peak(gravity, gravity.tracking_error, 0, 3)[:2].max() < 1e-3


def test_single_arm_rings_at_the_free_end():
    single = run("single-arm")
    tip = single.beam_coordinates[:, -2]
    assert 1e3 * peak(single, tip, 0, 0.5) == pytest.approx(says("single-arm", r"up to (\d+) mm"), abs=0.5)
    assert frequency(single, tip, 8) == pytest.approx(says("single-arm", r"mm at (\d+) Hz"), rel=0.05)
    assert 1e3 * peak(single, tip, 1, 3) == pytest.approx(says("single-arm", r"motion by (\S+) mm"), abs=0.05)
    assert np.abs(single.internal_force).max() < 1e-9


def test_weak_feedback_strays_until_it_adapts():
    scenario, ks = load_preset("weak-feedback"), ChangeScenario({"controller.adaptation": (0.1, 0.1, 0.1)})
    alone, adapted = simulate(scenario, 8.0), simulate(scenario, 8.0, commands=[(3.0, ks)])
    assert adapted.status == "finished"
    assert 1e3 * peak(alone, alone.tracking_error, 1, 8)[:2].max() == pytest.approx(
        says("weak-feedback", r"path by (\S+) mm"), abs=0.1
    )
    rms = [np.sqrt(np.mean(run.tracking_error[run.time >= 6, :2] ** 2)) for run in (alone, adapted)]
    assert rms[1] < 0.5 * rms[0]


def test_fast_adaptation_chatters_with_a_thin_boundary_layer():
    scenario = load_preset("fast-adaptation")
    thin = simulate(scenario, 3.0, commands=[(1.0, ChangeScenario({"controller.boundary_layer": 0.001}))])
    assert thin.status == "finished"
    runs = run("paper"), run("fast-adaptation"), thin
    paper, smooth, rough = (np.abs(np.diff(each.joint_torque[each.time >= 1.5], axis=0)).max() for each in runs)
    assert smooth == pytest.approx(paper, rel=0.05)
    assert rough == pytest.approx(says("fast-adaptation", r"to (\S+) N·m"), rel=0.15)


def test_vibration_damping_ends_the_ring_sooner():
    damped, paper = run("vibration-damping"), run("paper")
    for result, pattern in ((damped, r"within (\S+) s"), (paper, r"instead of (\S+) s")):
        end = says("vibration-damping", pattern)
        ring = peak(result, result.vibration, 0, 0.1)
        assert peak(result, result.vibration, end + 0.003, 3) < 0.01 * ring
    largest = 1e3 * peak(damped, damped.midspan_deflection, 1, 3)
    assert largest == pytest.approx(says("vibration-damping", r"bending of (\S+) mm"), abs=0.005)


def test_a_squeezed_beam_rings_more_slowly():
    name = "squeeze-until-it-buckles"
    squeezed = run(name)
    assert squeezed.axial_load.mean() == pytest.approx(-says(name, r"with (\S+) N"), rel=0.01)
    w = squeezed.midspan_deflection
    upwards = np.flatnonzero((w[:-1] < 0) & (w[1:] >= 0))
    hertz = (len(upwards) - 1) / (squeezed.time[upwards[-1]] - squeezed.time[upwards[0]])
    assert hertz == pytest.approx(says(name, r"rings at (\S+) Hz"), abs=0.05)
    assert 1e3 * w[0] == pytest.approx(says(name, r"bent by (\S+) mm"))


def test_a_spun_beam_lags_and_recovers_and_without_axial_load_diverges():
    spin_up = load_preset("spin-up").replace({"simulation.accuracy": 1e-6})
    whole = simulate(spin_up, 5.0, 0.01)
    tip = 1e3 * np.abs(whole.beam_coordinates[:, -2])
    assert tip.max() == pytest.approx(says("spin-up", r"up to (\S+) mm"), abs=0.5)
    assert tip[whole.time > 4.0].max() < 0.01 * tip.max()
    assert whole.pose_rate[-1, 2] == pytest.approx(says("spin-up", r"up to (\S+) rad/s"), rel=1e-3)
    stiffness_gone = whole.pose_rate[-1, 2] / np.sqrt(whole.spin_share[-1])
    assert stiffness_gone == pytest.approx(says("spin-up", r"from (\S+) rad/s"), abs=0.05)
    paper = simulate(spin_up.replace({"payload.axial_load": "none"}), 5.0, 0.01)
    assert paper.status == "diverged"
