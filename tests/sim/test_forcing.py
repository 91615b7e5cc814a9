"""A beam whose damping couples many modes: its responses to a few fixed forces give the same motion as whole matrices."""

import numpy as np
import pytest

from flexlab.compiled import compiled
from flexlab.physics.plant import DG, DH, ETA, PULL, G, H, Hand
from flexlab.presets import load_preset
from flexlab.sim.closed_loop import new_workspace, state_length
from flexlab.sim.integrators import etdrk4
from flexlab.sim.integrators.etdrk4 import HALF_EXP, add_rates, beam_operators, block_functions
from flexlab.sim.integrators.forcing import STIFF_MODE, factor_rates
from flexlab.sim.step_trial import build_assembly


@compiled
def factored(plant, ws, rates):
    factor_rates(plant, ws, rates)


@compiled
def product(plant, operators, function, rates, out):
    add_rates(plant, operators, function, rates, out)


def operators_of(assembly, dt: float):
    modes, modal = assembly.beam.modes, assembly.system.plant.modal
    linear = (modes.omega, modes.D, modes.block_start)
    return beam_operators(*linear, modal[: G + 1], dt, [block[:2] for block in block_functions(*linear, dt)])


@pytest.mark.parametrize("hand_pulls", [False, True])
@pytest.mark.parametrize(("preset", "elements"), [("paper", 24), ("paper", 40), ("single-arm", 20)])
def test_responses_to_a_few_forces_equal_products_with_whole_matrices(preset, elements, hand_pulls, monkeypatch):
    """All matrix functions agree, for rates as in the equations of motion with rotation at 10 rad/s."""
    scenario = load_preset(preset).replace({"payload.element_count": elements})
    scenario = scenario.replace({"gravity": 9.81})
    assembly, dt, rng = build_assembly(scenario, 1e-3), 1e-4, np.random.default_rng(3)
    few = operators_of(assembly, dt)
    monkeypatch.setattr(etdrk4, "is_factored", lambda block_start: False)
    whole = operators_of(assembly, dt)
    assert few.forced.size > 0 == whole.forced.size
    assert few.operators.size == whole.operators.size / 5
    assert any(soft < size for soft, size in zip(few.soft_modes, np.diff(assembly.beam.modes.block_start), strict=True))

    plant, n = assembly.system.plant, len(assembly.beam.modes.omega)
    if hand_pulls:
        plant.pull[:] = Hand(0.1, 0.0, 0.7, 500.0, -1.0, 0.0)
        plant.modal[PULL] = rng.normal(size=n)
    ws, y = new_workspace(assembly.system), np.zeros(state_length(assembly.system))
    ws.arm.trig[:] = np.cos(0.4), np.sin(0.4)
    ws.velocity[:] = 0.7, -1.1, 10.0
    # A bent beam: the response of a mode to a load falls with its stiffness.
    eta = 1e-2 * rng.normal(size=n) * (np.min(assembly.beam.modes.omega) / assembly.beam.modes.omega) ** 2
    c, s = ws.arm.trig
    v1, v2, w = c * 0.7 - s * 1.1, -c * 1.1 - s * 0.7, 10.0
    modal, rates = plant.modal, np.zeros_like(y)
    rates[ETA : ETA + n] = -modal[H] * v2 - modal[G] * w
    rates[ETA + n : ETA + 2 * n] = w**2 * eta - modal[H] * (w * v1 + 9.81 * c) + modal[DH] * v2 + modal[DG] * w
    rates[ETA + n : ETA + 2 * n] += 3.0 * modal[PULL] * hand_pulls

    made_of = rates.copy()
    factored(plant, ws, made_of)
    beam = slice(ETA, ETA + 2 * n)
    for function in range(HALF_EXP):
        right, found = np.zeros(2 * n), np.zeros(2 * n)
        product(plant, whole, function, rates[beam], right)
        product(plant, few, function, made_of[beam], found)
        for part in (slice(n), slice(n, 2 * n)):
            assert np.abs(found[part] - right[part]).max() < 1e-11 * np.abs(right[part]).max()


def test_only_modes_in_which_rotation_is_notable_count_as_soft():
    """Rotation at 10 rad/s takes away the share (10/Ω)² of a mode's stiffness."""
    assert (10 / STIFF_MODE) ** 2 < 2e-9
    fine = build_assembly(load_preset("paper").replace({"payload.element_count": 32}), 1e-3)
    found = operators_of(fine, 1e-4)
    starts, omega = fine.beam.modes.block_start, fine.beam.modes.omega
    assert list(np.diff(starts)) == [32, 32]
    for low, high, count in zip(starts[:-1], starts[1:], found.soft_modes, strict=True):
        assert 0 < count < 32
        assert np.all(omega[low : low + count] <= STIFF_MODE)
        assert np.all(omega[low + count : high] > STIFF_MODE)
