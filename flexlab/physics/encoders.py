"""What encoders tell of the pose: joint angles in whole counts, and the pose to which they belong.

An encoder of N counts per turn tells the nearest multiple of Δ = 2π/N: it is off by Δ/2 at most, and by Δ²/12 in the mean
square where the joint turns through many counts (Widrow & Kollár, Quantization Noise, 2008, ch. 4). Each arm's forward
kinematics make a pose of its three angles; what is measured is the mean of the arms' poses, and as its rate the difference of
two readings over the control period T_c, which lags by T_c/2 and takes one count for Δ/T_c.
"""

import numpy as np

from flexlab.compiled import compiled, inlined
from flexlab.numerics.elementary import sin_cos
from flexlab.physics.arm import joint_angles
from flexlab.physics.dynamics import configure_arms, find_velocities
from flexlab.physics.plant import joints_start


def encoder_counts(counts: tuple[float, ...]) -> np.ndarray:
    """`Joints.count` of the counts per turn (3,)."""
    return np.array([2 * np.pi / number if number > 0 else 0.0 for number in counts])


@inlined
def counted(angle, count):
    """What an encoder tells of an angle, rad; `count`: angle of one count, 0: exact."""
    return count * np.floor(angle / count + 0.5) if count > 0 else angle


@inlined
def pose_of_counts(count, arms, theta, terms, angle, pose):
    """Fill pose (3,) with what the encoders tell at the angle `theta` of the virtual link, after `configure_arms`.

    angle (3,): scratch.
    """
    share = 1.0 / len(arms)
    pose[0] = pose[1] = pose[2] = 0.0
    for i in range(len(arms)):
        arm = arms[i]
        joint_angles(theta, arm, terms.direction[i], angle)
        first = counted(angle[0], count[0])
        second = first + counted(angle[1], count[1])
        link = second + counted(angle[2], count[2]) - (np.pi if arm.tip < 0 else 0.0)
        s1, c1 = sin_cos(first)
        s2, c2 = sin_cos(second)
        s, c = sin_cos(link)
        pose[0] += share * (arm.base_x + arm.l1 * c1 + arm.l2 * c2 - arm.reach * c)
        pose[1] += share * (arm.base_y + arm.l1 * s1 + arm.l2 * s2 - arm.reach * s)
        pose[2] += share * link


@inlined
def read_encoders(joints, arms, period, states, ws, now):
    """Put what encoders tell in the place of the exact now.x and now.v, if there are any, after `configure_arms`.

    period: T_c, s; states: the joints' in y, where it is noted.
    """
    if joints is None:
        return
    if joints.reading >= 0:
        told, before = ws.momentum, states[joints.reading : joints.reading + 3]
        pose_of_counts(joints.count, arms, now.x[2], ws.arm, ws.tau, told)
        for a in range(3):
            now.x[a], now.v[a] = told[a], (told[a] - before[a]) / period
            before[a] = told[a]


@compiled
def begin_reading(plant, period, y, ws):
    """Note in y what encoders told one control period, s, ago, as the pose moved with its present rate.

    Where the arms could not be there, what they tell now.
    """
    find_velocities(plant, y, ws)
    _begin_reading(plant.joints, plant, period, y, ws)


@inlined
def _begin_reading(joints, plant, period, y, ws):
    if joints is None:
        return
    if joints.reading >= 0:
        before, first = ws.momentum, joints_start(plant) + joints.reading
        for a in range(3):
            before[a] = y[a] - period * ws.velocity[a]
        if configure_arms(plant, before, ws.arm, ws.fault) != 0:
            configure_arms(plant, y[0:3], ws.arm, ws.fault)
            before[2] = y[2]
        pose_of_counts(joints.count, plant.arms, before[2], ws.arm, ws.tau, y[first : first + 3])


@compiled
def told_pose(plant, pose, ws, told):
    """Fill told (3,) with what encoders tell at a pose (3,) that the arms can take; returns a fault code."""
    code = configure_arms(plant, pose, ws.arm, ws.fault)
    if code == 0:
        pose_of_counts(plant.joints.count, plant.arms, pose[2], ws.arm, ws.tau, told)
    return code
