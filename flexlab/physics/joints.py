"""The motor of each joint and the friction in it.

The friction torque of a joint that turns with θ̇ is viscous, and Coulomb's with Stribeck's fall from its static value, in the
smooth form of Hess & Soom (J. Tribology 112 (1990) 147-152):

    τ_f(θ̇) = B θ̇ + [C + (σ - 1) C/(1 + (θ̇/v_s)²)] θ̇/√(θ̇² + v_0²)

A sticking joint creeps at v_0 r/√(1 - r²) under the share r of σC: it never chatters, and the slope of the curve at rest,
B + σC/v_0, is resolved by the step. The links are driven by τ - τ_f, so that u_i = 𝒥ᵀ(τ - τ_f), and all forces and the input work
follow from that; Στ_f θ̇ is dissipated.

A motor is asked for τ_w and gives τ, with a lag of its time constant and a limit that depends on its speed, like a direct-current
motor with a supply of ±V (Franklin, Powell & Emami-Naeini, Feedback Control of Dynamic Systems, ch. 2; T_m = L/R):

    T_m τ̇ = clip(τ_w, -τ_s (1 + θ̇/ω_0), τ_s (1 - θ̇/ω_0)) - τ

with its stall torque τ_s and its no-load speed ω_0: it cannot drive a joint faster than that, and brakes one that others drive
faster. With T_m = 0, τ is the clipped value. The controller's own limit clips τ_w first.

With ideal joints `Plant.joints` is None, and the loop is compiled without all this.
"""

import numpy as np

from flexlab.compiled import inlined
from flexlab.physics.arm import joint_torques, task_input
from flexlab.physics.grips import own_rate, own_trig
from flexlab.physics.plant import Joints
from flexlab.physics.sensors import encoder_counts

VISCOUS, COULOMB, STATIC, STRIBECK, SMOOTHING, BELIEVED, STALL, FALL = range(8)
"""Rows of `Joints.numbers`, by joint: B, N·m·s/rad; C, N·m; (σ - 1)C, N·m; 1/v_s², s²/rad²; v_0², rad²/s²; believed τ_f over
the true one; τ_s, N·m, infinite where any torque is given; τ_s/ω_0, N·m·s/rad."""
ROWS = 8
LOSS = 0
"""Index of ∫Στ_f θ̇ dt, J, among the joints' states; others follow in the order of `joint_parts`."""


@inlined
def friction_torque(numbers, joint, rate):
    """τ_f, N·m, of a joint that turns with `rate`, rad/s."""
    square = rate * rate
    rising = numbers[STATIC, joint] / (1 + square * numbers[STRIBECK, joint])
    sliding = (numbers[COULOMB, joint] + rising) * (rate / np.sqrt(square + numbers[SMOOTHING, joint]))
    return numbers[VISCOUS, joint] * rate + sliding


@inlined
def joint_rate(terms, i, vx, vy, w, joint):
    """Rate of a relative joint of arm i, rad/s, at the pose rate (vx, vy, w), after `configure_arms`."""
    J = terms.J[i]
    first = J[0, 0] * vx + J[0, 1] * vy + J[0, 2] * w
    second = J[1, 0] * vx + J[1, 1] * vy + J[1, 2] * w
    return first if joint == 0 else second - first if joint == 1 else w - second


@inlined
def compensate_friction(joints, arms, terms, vx, vy, w, u, tau):
    """Add the believed friction at the pose rate (vx, vy, w) to u (arms, 3). tau (3,): scratch."""
    if joints is None:
        return
    for i in range(len(arms)):
        joint_torques(arms[i], terms.trig[0], terms.trig[1], terms.direction[i], u[i], tau)
        for joint in range(3):
            lost = friction_torque(joints.numbers, joint, joint_rate(terms, i, vx, vy, w, joint))
            tau[joint] += joints.numbers[BELIEVED, joint] * lost
        task_input(terms.J[i], tau, u[i])


@inlined
def possible_torque(numbers, joint, rate, torque):
    """A torque, N·m, clipped to what a motor can give at the joint rate `rate`, rad/s."""
    fall = numbers[FALL, joint] * rate
    return max(min(torque, numbers[STALL, joint] - fall), -numbers[STALL, joint] - fall)


@inlined
def turn_joints(joints, grips, arms, states, ws):
    """Turn ws.u from the inputs asked for into those that drive the links, after C̄_i; fills ws.joint_torque to ws.joint_rate.

    states: the joints' states in y.
    """
    if joints is None:
        return
    tau, loss = ws.tau, 0.0
    for i in range(len(arms)):
        c, s = own_trig(grips, ws, i)
        vx, vy, w = own_rate(grips, ws, i)
        joint_torques(arms[i], c, s, ws.arm.direction[i], ws.u[i], tau)
        for joint in range(3):
            rate = joint_rate(ws.arm, i, vx, vy, w, joint)
            lost = friction_torque(joints.numbers, joint, rate)
            given = possible_torque(joints.numbers, joint, rate, tau[joint])
            ws.joint_command[i, joint], ws.joint_feasible[i, joint] = tau[joint], given
            if joints.torque >= 0:
                place = joints.torque + 3 * i + joint
                ws.joint_rate[place] = (given - states[place]) * joints.lag_rate
                given = states[place]
            ws.joint_torque[i, joint], ws.joint_friction[i, joint] = given, lost
            tau[joint] = given - lost
            loss += lost * rate
        task_input(ws.arm.J[i], tau, ws.u[i])
    ws.joint_rate[LOSS] = loss


@inlined
def motor_torques(joints, grips, arm, i, ws, tau):
    """Fill tau (3,) with the torques of arm i's motors, N·m, after `turn_joints`."""
    if joints is None:
        c, s = own_trig(grips, ws, i)
        joint_torques(arm, c, s, ws.arm.direction[i], ws.u[i], tau)
    else:
        for joint in range(3):
            tau[joint] = ws.joint_torque[i, joint]


@inlined
def has_motors(joints):
    """Whether motors may give another torque than they are asked for."""
    if joints is None:
        return False
    return joints.has_motors


@inlined
def is_limited(joints, i, joint, limit, ws):
    """Whether a motor is asked for the `limit`, N·m, or for more than its speed allows, after `turn_joints`."""
    if joints is None:
        return False
    asked = ws.joint_command[i, joint]
    return ws.joint_feasible[i, joint] != asked or abs(asked) >= limit


@inlined
def commanded_torques(joints, grips, arm, i, ws, tau):
    """Fill tau (3,) with the torques that the controller asks of arm i's motors, N·m, after `turn_joints`."""
    if joints is None:
        c, s = own_trig(grips, ws, i)
        joint_torques(arm, c, s, ws.arm.direction[i], ws.u[i], tau)
    else:
        for joint in range(3):
            tau[joint] = ws.joint_command[i, joint]


@inlined
def near_possible(joints, grips, ws, part):
    """Whether any motor is asked for more than the share `part` of what it can give at its speed, after `turn_joints`."""
    if joints is None:
        return False
    found = False
    for i in range(len(ws.joint_command)):
        vx, vy, w = own_rate(grips, ws, i)
        for joint in range(3):
            asked, rate = ws.joint_command[i, joint], joint_rate(ws.arm, i, vx, vy, w, joint)
            fall = joints.numbers[FALL, joint] * rate
            room = joints.numbers[STALL, joint] - (fall if asked > 0 else -fall)
            if abs(asked) > part * room:
                found = True
    return found


def build_joints(joints, model, arm_count: int) -> Joints | None:
    """`Plant.joints` of a scenario's joints; `model`: what its controller believes."""
    friction, motor, encoders = joints.friction, joints.motor, joints.encoders
    if not joints.active:
        return None
    coulomb, numbers = np.array(friction.coulomb), np.empty((ROWS, 3))
    numbers[VISCOUS], numbers[COULOMB] = friction.viscous, coulomb
    numbers[STATIC] = (friction.static_factor - 1) * coulomb
    numbers[STRIBECK] = 1 / (friction.stribeck_speed * friction.stribeck_speed)
    numbers[SMOOTHING] = friction.smoothing_speed * friction.smoothing_speed
    numbers[BELIEVED] = model.friction_factor
    stall = np.array(motor.stall_torque)
    numbers[STALL], numbers[FALL] = np.where(stall > 0, stall, np.inf), stall / np.array(motor.no_load_speed)
    reading, torque, late = 1, 1 + 3 * encoders.active, motor.time_constant > 0
    return Joints(
        numbers,
        size=torque + 3 * arm_count * late,
        has_friction=friction.active,
        count=encoder_counts(encoders.counts),
        reading=reading if encoders.active else -1,
        has_motors=motor.active,
        lag_rate=1 / motor.time_constant if late else 0.0,
        torque=torque if late else -1,
    )


def joint_parts(joints: Joints | None) -> dict[str, slice]:
    """The place of each part within the joints' states, by name."""
    if joints is None:
        return {}
    parts = {"loss": slice(LOSS, LOSS + 1)}
    if joints.reading >= 0:
        parts["reading"] = slice(joints.reading, joints.reading + 3)
    if joints.torque >= 0:
        parts["torque"] = slice(joints.torque, joints.size)
    return parts


@inlined
def steepest_friction(numbers, joint):
    """Largest slope of τ_f, which it has at rest, plus that of the motor's limit, N·m·s/rad."""
    static = numbers[COULOMB, joint] + numbers[STATIC, joint]
    return numbers[VISCOUS, joint] + static / np.sqrt(numbers[SMOOTHING, joint]) + numbers[FALL, joint]


@inlined
def friction_form(joints, terms, form):
    """Fill form (3, 3) with Σ𝒥ᵀB'𝒥, B' the steepest slopes over the arms' relative joints, after `configure_arms`."""
    for a in range(3):
        for b in range(3):
            total = 0.0
            for i in range(len(terms.J)):
                J = terms.J[i]
                a3, b3 = 1.0 if a == 2 else 0.0, 1.0 if b == 2 else 0.0
                total += steepest_friction(joints.numbers, 0) * J[0, a] * J[0, b]
                total += steepest_friction(joints.numbers, 1) * (J[1, a] - J[0, a]) * (J[1, b] - J[0, b])
                total += steepest_friction(joints.numbers, 2) * (a3 - J[1, a]) * (b3 - J[1, b])
            form[a, b] = total
