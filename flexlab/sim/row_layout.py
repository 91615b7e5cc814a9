"""Where each signal of `Samples` stands in a row that the kernel writes."""

import numpy as np

from flexlab.sim.samples import Samples

TIME, POSE, RATE, ACCELERATION, DESIRED, ERROR, SLIDING, ESTIMATES, MOVING = 0, 1, 4, 7, 10, 13, 16, 19, 22
MIDSPAN, QUASI_STATIC, KINETIC, ELASTIC, GRAVITY, WORK, DISSIPATION, SATURATED = 25, 26, 27, 28, 29, 30, 31, 32
ARMS = 33
"""First column of the arms; each has joint angle, joint torque, input and internal force, three columns each."""
PER_ARM = 12


def row_length(arm_count: int, coordinate_count: int) -> int:
    """Columns of one sample: fixed signals, arms, q and q̇."""
    return ARMS + PER_ARM * arm_count + 2 * coordinate_count


def rows_to_samples(rows: np.ndarray, arm_count: int) -> Samples:
    """Read-only views of the signals in rows (N, row_length)."""
    rows = rows.view()
    rows.flags.writeable = False
    arms = rows[:, ARMS : ARMS + PER_ARM * arm_count].reshape(len(rows), arm_count, 4, 3)
    beam = rows[:, ARMS + PER_ARM * arm_count :]
    n_q = beam.shape[1] // 2
    return Samples(
        time=rows[:, TIME],
        pose=rows[:, POSE : POSE + 3],
        pose_rate=rows[:, RATE : RATE + 3],
        pose_acceleration=rows[:, ACCELERATION : ACCELERATION + 3],
        desired_pose=rows[:, DESIRED : DESIRED + 3],
        beam_coordinates=beam[:, :n_q],
        beam_rates=beam[:, n_q:],
        tracking_error=rows[:, ERROR : ERROR + 3],
        sliding_variable=rows[:, SLIDING : SLIDING + 3],
        bound_estimates=rows[:, ESTIMATES : ESTIMATES + 3],
        joint_angle=arms[:, :, 0],
        joint_torque=arms[:, :, 1],
        arm_input=arms[:, :, 2],
        internal_force=arms[:, :, 3],
        moving_force=rows[:, MOVING : MOVING + 3],
        midspan_deflection=rows[:, MIDSPAN],
        quasi_static_deflection=rows[:, QUASI_STATIC],
        kinetic_energy=rows[:, KINETIC],
        elastic_energy=rows[:, ELASTIC],
        gravity_energy=rows[:, GRAVITY],
        input_work=rows[:, WORK],
        dissipated_energy=rows[:, DISSIPATION],
        saturated=rows[:, SATURATED],
    )
