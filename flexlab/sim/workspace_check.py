"""Whether both arms can follow the whole desired trajectory, found before a run starts."""

import math

import numpy as np

from flexlab.control.motion import poses as desired_motions
from flexlab.control.path import build_motion
from flexlab.physics.arm import SINGULAR_SINE
from flexlab.scenario import Scenario
from flexlab.sim.samples import Status
from flexlab.sim.target import desired_at
from flexlab.sim.termination import elbow_sine, pose_fault, wrist_reach

SURE = 1.01
"""Factor on the least elbow sine beyond which rounding cannot matter."""


def check_trajectory(scenario: Scenario) -> Status | None:
    """The fault of the first desired pose that an arm cannot take, over the whole path; None if all can be taken."""
    if _surely_reached(scenario):
        return None
    path, motion = scenario.trajectory, build_motion(scenario.trajectory)
    if path.span == 0:
        return pose_fault(scenario, desired_at(motion, 0.0)[0], 0.0, path.place_text(0.0))
    times = path.instants
    poses = desired_motions(motion, times)[:, 0]
    doubtful = np.zeros(len(times), bool)
    for index in range(len(scenario.arms)):
        l1, l2, _ = scenario.arms[index].link_length
        doubtful |= elbow_sine(wrist_reach(scenario, index, poses)[0], l1, l2) < SINGULAR_SINE
    for k in np.flatnonzero(doubtful)[:1]:
        return pose_fault(scenario, poses[k], float(times[k]), path.place_text(float(times[k])))
    return None


def _surely_reached(scenario: Scenario) -> bool:
    """Whether every pose of the path's bounding box keeps both wrists well inside what the arms span.

    Most paths pass, and a slider sends twenty a second: looking at every instant costs milliseconds. A wrist moves at most
    as far as its pose's origin and the chord of its turn; the elbow's sine is least at an end of a range of distances.
    """
    path = scenario.trajectory
    x, y, turn = path.reach
    for index in range(len(scenario.arms)):
        arm = scenario.arms[index]
        l1, l2, l3 = arm.link_length
        chord = 2 * (scenario.payload.length / 2 + l3) * math.sin(min(turn, math.pi) / 2)
        middle, moved = float(wrist_reach(scenario, index, np.array(path.middle))[0]), math.hypot(x, y) + chord
        nearest, farthest = max(middle - moved, 0.0), middle + moved
        sines = elbow_sine(np.array([nearest, farthest]), l1, l2)
        if sines.min() < SURE * SINGULAR_SINE:
            return False
    return True


def same_reach(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios ask the same of the arms, so that what was checked for one holds for the other."""
    return (
        one.trajectory == other.trajectory
        and one.payload.length == other.payload.length
        and one.left_arm == other.left_arm
        and one.right_arm == other.right_arm
    )
