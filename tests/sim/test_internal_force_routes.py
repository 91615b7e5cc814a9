"""The internal force by Eqs. (13)-(15), as sampled, and by Eq. (26) in nodal coordinates."""

from pathlib import Path

import numpy as np
import pytest
from reference.solutions import CASES, PAPER, Solution
from reference.terms import arm_terms

import flexlab
from flexlab.errors import StudyError
from flexlab.physics.internal_force import internal_force_by_eq_26
from flexlab.sim.build import nodal_damping_matrix
from flexlab.sim.commands import ChangeScenario, Pull, Tap
from flexlab.sim.world import World

TWO_ARMS = [case for case in CASES if len(case.scenario.arms) == 2]


@pytest.mark.parametrize("case", [PAPER, *TWO_ARMS[1:]], ids=lambda case: case.name)
def test_both_routes_agree(case: Solution):
    """They agree to 1e-9 of the larger forces whose difference they are, at samples spread over half a second.

    Eq. (26) computes ẍ again from dense matrices in (x, q); its terms M̄_i ẍ and u_i cancel down to the internal force.
    """
    world = World(case.scenario)
    samples = world.run(min(500, int(case.rows[-1])))
    assert not world.status.failed
    D, plant = nodal_damping_matrix(world.beam), world.system.plant
    for k in range(0, len(samples), 23):
        pose, rate = samples.pose[k], samples.pose_rate[k]
        terms = arm_terms(plant, pose, rate)
        force = internal_force_by_eq_26(
            world.beam.matrices,
            D,
            terms.M,
            terms.C,
            terms.G,
            samples.arm_input[k],
            pose,
            rate,
            samples.beam_coordinates[k],
            samples.beam_rates[k],
            case.scenario.gravity,
        )
        scale = max(np.abs(samples.arm_input[k]).max(), np.abs(terms.M @ samples.pose_acceleration[k]).max())
        np.testing.assert_allclose(force, samples.internal_force[k], rtol=0, atol=1e-9 * scale)


def test_users_can_compute_eq_26_for_samples_of_a_run():
    """`flexlab.internal_force_eq_26` takes every 10th sample here, and refuses in a sentence what makes no sense."""
    run = flexlab.simulate("paper", 0.3)
    found = flexlab.internal_force_eq_26(run, every=10)
    assert found.shape == (31, 2, 3)
    np.testing.assert_allclose(found, run.internal_force[::10], rtol=0, atol=1e-9 * np.abs(run.arm_input).max())
    with pytest.raises(StudyError, match="two arms"):
        flexlab.internal_force_eq_26(flexlab.simulate("single-arm", 0.01))
    for every in (0, -1, 1.5):
        with pytest.raises(StudyError, match=f"every = {every} is not usable"):
            flexlab.internal_force_eq_26(run, every=every)  # type: ignore[arg-type]


def test_eq_26_is_refused_for_runs_that_it_does_not_describe(tmp_path: Path):
    """It used to be off by newtons: it left out the axial load, and after a change it used the first scenario."""
    with pytest.raises(StudyError, match=r"feels no force along it \(payload\.axial_load\)"):
        flexlab.internal_force_eq_26(flexlab.simulate("squeeze-until-it-buckles", 0.01))
    for command in (ChangeScenario({"payload.bending_stiffness": 50.0}), Pull(0.0, (0.0, 1.0), 100.0)):
        run = flexlab.simulate("paper", 0.03, commands=[(0.01, command)])
        for one in (run, flexlab.read(run.save(tmp_path))):
            with pytest.raises(StudyError, match="this run was changed or pulled"):
                flexlab.internal_force_eq_26(one)
    tapped = flexlab.simulate("paper", 0.03, commands=[(0.01, Tap(0.0, (0.0, 0.1)))])
    np.testing.assert_allclose(flexlab.internal_force_eq_26(tapped), tapped.internal_force, rtol=0, atol=1e-9)


def test_internal_forces_of_two_arms_cancel():
    """F_1 + F_2 = 0 (Eq. 15)."""
    samples = World(PAPER.scenario).run(300)
    total = samples.internal_force.sum(axis=1)
    assert np.abs(total).max() < 1e-12 * np.abs(samples.arm_input).max()


def test_a_single_arm_has_no_internal_force():
    """One arm has nothing to press against."""
    single = next(case for case in CASES if len(case.scenario.arms) == 1)
    samples = World(single.scenario).run(100)
    assert np.abs(samples.internal_force).max() < 1e-12 * np.abs(samples.arm_input).max()


def test_moving_force_is_each_arms_share_of_what_moves_the_payload():
    """f = Σ(u_i - M̄_iẍ - C̄_iẋ - Ḡ_i), and J_iᵀf_i = F_i + ½f (Eqs. 13, 14)."""
    world = World(next(case for case in CASES if case.name == "gravity-n2").scenario)
    samples, plant = world.run(100), world.system.plant
    for k in range(0, 101, 20):
        terms = arm_terms(plant, samples.pose[k], samples.pose_rate[k])
        accelerated = terms.M @ samples.pose_acceleration[k] + terms.C @ samples.pose_rate[k]
        grip = samples.arm_input[k] - accelerated - terms.G
        scale = np.abs(samples.arm_input[k]).max()
        np.testing.assert_allclose(samples.moving_force[k], grip.sum(axis=0) / 2, rtol=0, atol=1e-12 * scale)
        np.testing.assert_allclose(
            samples.internal_force[k] + samples.moving_force[k], grip, rtol=0, atol=1e-12 * scale
        )
