"""The engine's own control law for other engines: they get the same torques for the same state, at compiled speed."""

from flexlab.compiled import compiled
from flexlab.control.law_kernels import control_law
from flexlab.control.motion import desired_motion
from flexlab.physics.arm import arm_velocity_terms, joint_torques
from flexlab.physics.dynamics import configure_arms


@compiled
def joint_torque_law(system, t, x, v, memory, ws, tau):
    """Fill the joint torques tau (arms, 3), N·m, and the memory's rates (ws.memory_rate) at pose x and rate v (3,).

    Returns a fault code of `physics.arm`.
    """
    plant = system.plant
    code = configure_arms(plant, x, ws.arm, ws.fault)
    if code != 0:
        return code
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    for i in range(len(plant.arms)):
        arm_velocity_terms(plant.arms[i], c, s, v[0], v[1], v[2], ws.arm.J[i], ws.arm.direction[i], ws.arm.C[i])
    desired_motion(system.trajectory, t, ws.desired)
    # The other engines keep the laws' memory, not their signals: an empty vector stands for these.
    control_law(
        system.control, plant.gravity, x, v, ws.beam_rate, ws.desired, ws.truth[0], memory, ws.memory_rate, memory[:0]
    )
    for i in range(len(plant.arms)):
        joint_torques(plant.arms[i], c, s, ws.arm.direction[i], ws.u[i], tau[i])
    return code
