"""States between two samples."""

import numpy as np

from flexlab.presets import load_preset
from flexlab.sim.pacing import interpolate
from flexlab.sim.world import World


def ends():
    world = World(load_preset("paper"))
    world.advance(20)
    before = world.observe()
    world.advance(1)
    return before, world.observe()


def test_fraction_0_gives_the_earlier_sample_and_fraction_1_the_later_one():
    before, after = ends()
    assert interpolate(before, after, 1.0) is after
    for name in ("pose", "beam_coordinates", "time", "joint_torque"):
        np.testing.assert_allclose(getattr(interpolate(before, after, 0.0), name), getattr(before, name), rtol=1e-14)


def test_interpolated_states_agree_with_finer_samples():
    """Cubic in time: pose within 1e-8 m and beam within 2e-6 m of states computed every 0.1 ms."""
    before, after = ends()
    fine = World(load_preset("paper"), 1e-4)
    fine.advance(200)
    samples = fine.advance(9)
    for k, fraction in enumerate(np.arange(1, 10) / 10):
        state = interpolate(before, after, float(fraction))
        assert state.time[0] == np.float64(before.time[0] + fraction * (after.time[0] - before.time[0]))
        np.testing.assert_allclose(state.pose[0], samples.pose[k], rtol=0, atol=1e-8)
        np.testing.assert_allclose(state.beam_coordinates[0, 1], samples.beam_coordinates[k, 1], rtol=0, atol=2e-6)


def test_states_of_different_meshes_are_not_mixed():
    """The later sample is returned as it is."""
    before, _ = ends()
    other = World(load_preset("paper").replace({"payload.element_count": 5})).observe()
    assert interpolate(before, other, 0.3) is other


def test_an_interpolated_state_is_read_only_like_every_sample():
    state = interpolate(*ends(), 0.5)
    for name in ("pose", "beam_coordinates", "time", "saturated"):
        assert not getattr(state, name).flags.writeable


def test_a_joint_that_passes_half_a_turn_goes_on_turning():
    """Its angle goes from π to −π; in slow motion the arm was drawn all the way round, backwards."""
    before, after = ends()
    angles = [sample.joint_angle.copy() for sample in (before, after)]
    angles[0][0, 0, 0], angles[1][0, 0, 0] = 3.14, -3.14
    state = interpolate(before.having(joint_angle=angles[0]), after.having(joint_angle=angles[1]), 0.5)
    np.testing.assert_allclose(np.remainder(state.joint_angle[0, 0, 0], 2 * np.pi), np.pi, atol=1e-12)
    np.testing.assert_allclose(state.joint_angle[0, 1], interpolate(before, after, 0.5).joint_angle[0, 1], atol=1e-15)
