"""The engine computes what the guide's chapters state, beyond the lessons."""

import numpy as np
import pytest

from flexlab.analysis.modes import modes
from flexlab.guide import chapters
from flexlab.physics.plant import make_workspace
from flexlab.presets import load_preset
from flexlab.sim.assembly import build_system
from flexlab.sim.build import build_beam
from flexlab.sim.closed_loop import rates_at
from flexlab.sim.simulate import simulate
from flexlab.sim.world import World

TEXT = {chapter.id: chapter.text.replace("\n", " ") for chapter in chapters()}


def test_the_guide_states_the_frequencies_of_the_papers_beam():
    payload = load_preset("paper").payload
    exact = [
        np.pi * k**2 / (2 * payload.length**2) * np.sqrt(payload.bending_stiffness / payload.linear_density)
        for k in (1, 2, 3)
    ]
    assert ", ".join(f"{hertz:.1f} Hz" for hertz in exact) in TEXT["the-equations"]
    assert f"two elements give {modes(load_preset('paper')).frequency[0]:.1f} Hz" in TEXT["the-equations"]


def test_sideways_motion_excites_odd_modes_and_turning_even_ones():
    assert "they excite the odd modes (1, 3, …). When the link turns, it excites the even ones" in TEXT["what-you-see"]
    fine = load_preset("paper").replace({"payload.element_count": 8})
    found = modes(fine)
    assert found.lateral_participation[[1, 3]].max() < 1e-12 < 0.05 < found.lateral_participation[[0, 2]].min()
    assert found.angular_participation[[0, 2]].max() < 1e-12 < 0.05 < found.angular_participation[[1, 3]].min()
    assert (found.lateral_participation[0], found.angular_participation[1]) == pytest.approx(
        (8 / np.pi**2, 6 / np.pi**2), rel=1e-3
    )


@pytest.mark.parametrize("preset", ["paper", "soft-beam", "fast-adaptation"])
def test_the_formula_of_the_internal_force_is_exact(preset: str):
    """F1 = -½(M̄1 - M̄2)ṡ - ½(C̄1 - C̄2)s under continuous control, whatever the beam does."""
    scenario = load_preset(preset).replace({"controller.control_period": None})
    world = World(scenario)
    world.advance_rows(137)
    beam = build_beam(scenario.payload)
    system, workspace = build_system(scenario, beam), make_workspace(2, len(beam.modes.omega))
    y = world.state().y
    assert rates_at(system, world.time, y, workspace, np.zeros_like(y), True) == 0
    sample = world.observe()
    s, slope = sample.sliding_variable[0], scenario.controller.sliding_slope
    error_rate = sample.pose_rate[0] - workspace.desired[1]
    s_dot = sample.pose_acceleration[0] - workspace.desired[2] + slope * error_rate
    M, C = workspace.arm.M, workspace.arm.C
    expected = -0.5 * (M[0] - M[1]) @ s_dot - 0.5 * (C[0] - C[1]) @ s
    np.testing.assert_allclose(sample.internal_force[0, 0], expected, rtol=1e-9, atol=1e-9)


def test_the_guide_states_the_tracking_error_of_the_papers_run():
    paper = simulate(load_preset("paper"), 3.0)
    error = 1e3 * np.abs(paper.tracking_error[:, :2])
    assert f"{error.max():.0f} mm after the start" in TEXT["reading-the-plots"]
    assert f"at most {error[paper.time >= 1].max():.1f} mm from t = 1 s on" in TEXT["reading-the-plots"]


def test_energy_changes_by_the_work_less_the_loss():
    paper = simulate(load_preset("paper"), 1.0)
    change = paper.total_energy - paper.total_energy[0]
    np.testing.assert_allclose(change, paper.input_work - paper.dissipated_energy, atol=1e-5)
