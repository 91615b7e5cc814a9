"""Jumps of the desired velocity, acceleration or jerk cost no accuracy wherever they lie between samples and steps."""

from typing import Any

import numpy as np
import pytest

from flexlab.control.motion import path_time, time_of
from flexlab.presets import load_preset
from flexlab.scenario import Scenario
from flexlab.sim.samples import Samples
from flexlab.sim.world import World

FINE = 1e-5
"""Step, s: all discontinuities of the paths below are multiples of it, but not of any automatic step."""
TICK, TICKS = 0.005, 14
SIGNALS = ("pose", "pose_rate", "tracking_error", "beam_coordinates", "joint_torque", "internal_force", "input_work")

LINE = {"from": (0.0, 0.65, 0.0), "to": (0.01, 0.66, 0.03), "start": 0.01173, "duration": 0.04234}
ROWS = ((0.0, 0.0, 0.65, 0.0), (0.01, 0.01, 0.66, 0.01), (0.02, 0.01, 0.67, 0.05), (0.03, 0.0, 0.68, 0.0))
POSES = ((0.0, 0.65, 0.0), (0.005, 0.66, 0.0))
SHAPED = {"shaper": "zvd", "shaper_frequency": 1 / (2 * 0.01137), "shaper_damping": 0.0}
PATHS: dict[str, dict[str, Any]] = {
    "bang-bang": {"kind": "bang-bang", **LINE},
    "rest-to-rest": {"kind": "rest-to-rest", **LINE},
    "shaped bang-bang": {"kind": "bang-bang", **LINE, **SHAPED},
    "shaped sine": {"kind": "sine", **SHAPED},
    "shaped circle": {"kind": "circle", **SHAPED},
    "table with free ends": {
        "kind": "table",
        "start": 0.00777,
        "ends": "free",
        "rows": (*ROWS, (0.04, 0.0, 0.7, 0.0), (0.04562, 0.01, 0.7, 0.01)),
    },
    # Four phases of ∛(distance / 2 jerk) = 0.01173 s each.
    "waypoints": {"kind": "waypoints", "points": POSES, "start": 0.00314, "jerk_limit": 0.01 / (2 * 0.01173**3),
                  "acceleration_limit": 1e3, "velocity_limit": 100.0},
}  # fmt: skip


def scenario(path: str, **changes: Any) -> Scenario:
    beam = {"payload.bending_stiffness": 20.0, "gravity": 2.0}
    return load_preset("paper").replace({**beam, "trajectory": PATHS[path], **changes})


def run(wanted: Scenario) -> Samples:
    world = World(wanted, TICK)
    samples = world.run(TICKS)
    assert world.status == "running", world.status.text
    assert not world.accuracy_warning
    return samples


@pytest.mark.parametrize(("path", "integrator"), [*((path, "etdrk4") for path in PATHS), ("shaped bang-bang", "rk4")])
def test_discontinuities_between_steps_cost_no_accuracy(path: str, integrator: str):
    """The run is within 1e-7 of one whose steps end at them; a step across one is off by 1e-3 to 0.1 of the force's peak."""
    found = run(scenario(path, **{"simulation.accuracy": 1e-12, "simulation.integrator": integrator}))
    exact = run(scenario(path, **{"simulation.step": FINE}))
    for signal in SIGNALS:
        right = exact[signal]
        assert np.abs(found[signal] - right).max() < 1e-7 * np.abs(right).max(), signal


def test_a_system_knows_the_discontinuities_of_its_path():
    """Those of the shaped sine are where its copies begin, those of the shaped move where a copy's acceleration jumps."""
    delays = 0.01137 * np.arange(3)
    assert World(scenario("shaped sine")).system.trajectory.discontinuities == pytest.approx(delays[1:])
    jumps = LINE["start"] + LINE["duration"] * np.array([0, 0.5, 1])
    assert World(scenario("shaped bang-bang")).system.trajectory.discontinuities == pytest.approx(
        np.sort(np.add.outer(delays, jumps).ravel())
    )
    assert not len(World(load_preset("paper")).system.trajectory.discontinuities)


@pytest.mark.parametrize("along", [1e-6, 0.01, 0.15, 0.2, 3.0])
def test_time_of_inverts_the_path_time_of_a_smooth_start(along: float):
    assert path_time(time_of(along, 0.4), 0.4)[0] == pytest.approx(along, rel=1e-12)


def test_blocks_of_any_size_give_the_same_bits():
    whole, parts = World(scenario("shaped bang-bang"), 0.001), World(scenario("shaped bang-bang"), 0.001)
    rows = whole.advance_rows(60)
    blocks = np.concatenate([parts.advance_rows(size) for size in (1, 11, 2, 1, 1, 7, 37)])
    assert np.array_equal(rows, blocks)
    assert np.array_equal(rows[:, 0], 0.001 * np.arange(1, 61))
