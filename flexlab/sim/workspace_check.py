"""Whether both arms can follow the whole desired trajectory, found before a run starts."""

import numpy as np

from flexlab.physics.arm import SINGULAR_SINE
from flexlab.scenario import Scenario
from flexlab.sim.build import build_trajectory, desired_at
from flexlab.sim.samples import Status
from flexlab.sim.termination import elbow_sine, pose_fault, wrist_reach

POINTS_PER_PERIOD = 200
"""Samples per period of the fastest component: the path between two is under 1e-3 of the amplitude from a chord."""

LONGEST_CHECK = 20_000
"""Most instants looked at; motions of incommensurable frequencies never repeat, so somewhere the check must end."""


def check_trajectory(scenario: Scenario, duration: float | None = None) -> Status | None:
    """The fault of the first desired pose that an arm cannot take, over one period (or `duration`, s); None if all can."""
    path = scenario.trajectory
    moving = [f for f, a in zip(path.frequency, path.amplitude, strict=True) if a != 0 and f > 0]
    trajectory = build_trajectory(scenario)
    if not moving:
        return pose_fault(scenario, desired_at(trajectory, 0.0)[0], 0.0, "the desired pose")
    span = 1 / min(moving) * (1 if len(set(moving)) == 1 else 10)
    if duration is not None:
        span = min(span, duration)
    step = 1 / (POINTS_PER_PERIOD * max(moving))
    times = np.linspace(0, span, min(LONGEST_CHECK, max(2, int(span / step) + 1)))
    angle = 2 * np.pi * np.outer(times, path.frequency) + path.phase
    poses = np.array(path.center) + np.array(path.amplitude) * np.sin(angle)
    doubtful = np.zeros(len(times), bool)
    for index in range(len(scenario.arms)):
        l1, l2, _ = scenario.arms[index].link_length
        doubtful |= elbow_sine(wrist_reach(scenario, index, poses)[0], l1, l2) < SINGULAR_SINE
    for k in np.flatnonzero(doubtful)[:1]:
        return pose_fault(scenario, poses[k], float(times[k]), "the desired pose")
    return None
