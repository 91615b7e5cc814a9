"""Motors with limited torques."""

import numpy as np
import pytest

from flexlab.presets import load_preset
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

LIMIT = np.array([300.0, 200.0, 60.0])


def run(**changes) -> Samples:
    world = World(load_preset("paper").replace({"controller.torque_limit": LIMIT} | changes))
    samples = world.run(300)
    assert world.status == "running", world.status.text
    return samples


CONTROL = {
    "continuous": {},
    "sampled": {"controller.control_period": 0.001},
    "slowly sampled": {"controller.control_period": 0.004},
    "delayed": {"controller.control_period": 0.001, "controller.input_delay": 2},
}


@pytest.mark.parametrize("changes", CONTROL.values(), ids=CONTROL)
def test_no_torque_passes_its_limit(changes: dict):
    """|τ_j| ≤ τ_max,j on every joint at every sample; the jerk drives torques to their limits."""
    torque = np.abs(run(**changes).joint_torque)
    assert np.all(torque <= LIMIT * (1 + 1e-12))
    assert np.any(np.isclose(torque, LIMIT, rtol=1e-12))


@pytest.mark.parametrize("changes", CONTROL.values(), ids=CONTROL)
def test_saturation_is_reported_where_a_torque_stands_at_its_limit(changes: dict):
    """`saturated` is 1 on every sample whose torques stand at a limit; far from any limit it is 0."""
    samples = run(**changes)
    at_limit = np.isclose(np.abs(samples.joint_torque), LIMIT, rtol=1e-9).any(axis=(1, 2))
    assert np.all(samples.saturated[at_limit] == 1)
    far = (np.abs(samples.joint_torque) < 0.7 * LIMIT).all(axis=(1, 2))
    assert far.sum() > 100
    assert np.all(samples.saturated[far] == 0)


def test_wide_limits_change_nothing():
    """With a limit that is never reached, the run is the same to rounding and never saturated."""
    free = World(load_preset("paper")).run(100)
    wide = World(load_preset("paper").replace({"controller.torque_limit": (1e5, 1e5, 1e5)})).run(100)
    np.testing.assert_allclose(wide.pose, free.pose, rtol=0, atol=1e-12)
    assert not wide.saturated.any()
    assert not free.saturated.any()


def test_limited_motors_still_bring_the_payload_to_its_path():
    """With half the torque that the start asks for, it takes longer, and then tracks."""
    world = World(load_preset("paper").replace({"controller.torque_limit": (350.0, 250.0, 100.0)}))
    samples = world.run(2000)
    assert samples.saturated[:10].any()
    assert np.abs(samples.tracking_error[1500:, :2]).max() < 1e-3
