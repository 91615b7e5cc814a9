"""The energy that generalized-alpha itself takes out of each mode."""

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.build import build_beam
from flexlab.sim.integrators.generalized_alpha import ALPHA_F, ALPHA_M, BETA, GAMMA, RHO
from flexlab.sim.simulate import simulate


def ringing(mode: int, **changes) -> Scenario:
    """A run in which one mode (0: lowest) rings, without control and damping, on a mesh of four elements."""
    plain = load_preset("paper").replace(
        {"controller.kind": "none", "payload.element_count": 4, "payload.damping.coefficient": 0.0}
    )
    modes = build_beam(plain.payload).modes
    order = np.argsort(modes.omega)
    shape = modes.V[:, order[mode]] / modes.omega[order[mode]]
    return plain.replace(
        {"initial.beam_coordinates": 0.1 * shape, "simulation.integrator": "generalized-alpha"} | changes
    )


def decay_rate(run) -> float:
    """-d(ln E)/dt, 1/s, from a straight line fitted to ln E."""
    return -float(np.polyfit(run.time, np.log(run.total_energy), 1)[0])


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_the_lowest_three_modes_lose_under_one_per_cent_in_ten_seconds(mode: int):
    """The rate of loss at the default step is measured over half a second of free ringing."""
    rate = decay_rate(simulate(ringing(mode), 0.5))
    loss = 1 - np.exp(-10 * rate)
    assert -1e-6 < loss < 0.01


def spectral_radius(frequency_times_step: float) -> float:
    """Spectral radius of one generalized-alpha step of ü + ω²u = 0."""
    z = frequency_times_step**2
    # Unknowns (u, h u̇, h² ü): two update rules and the balance at the shifted instant.
    left = np.array([[1, 0, -BETA], [0, 1, -GAMMA], [(1 - ALPHA_F) * z, 0, 1 - ALPHA_M]])
    right = np.array([[1, 1, 0.5 - BETA], [0, 1, 1 - GAMMA], [-ALPHA_F * z, 0, -ALPHA_M]])
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(left, right))).max())


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_each_mode_loses_what_the_methods_theory_says(mode: int):
    """With grips that heavy links hold still, the energy of a mode falls by the spectral radius squared per step."""
    heavy = {f"{side}_arm.link_mass": (1e4, 1e4, 1e4) for side in ("left", "right")}
    step = 2e-4
    scenario = ringing(mode, **heavy, **{"simulation.step": step})
    omega = np.sort(build_beam(scenario.payload).modes.omega)[mode]
    expected = -2 * np.log(spectral_radius(omega * step)) / step
    assert decay_rate(simulate(scenario, 0.5)) == pytest.approx(expected, rel=0.03)


def test_modes_far_beyond_the_step_lose_a_fifth_of_their_amplitude_per_step():
    """ρ∞ = 0.8 is what the method promises for modes that the step cannot resolve."""
    assert pytest.approx(0.8) == RHO
    assert spectral_radius(1e6) == pytest.approx(RHO, rel=1e-4)
