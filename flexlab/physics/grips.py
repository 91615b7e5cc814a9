"""Compliant grips: a spring and a damper between each arm's last link and the end of the beam that it holds.

The paper's grips are rigid: all arms move with the pose x of the payload's virtual link. With a compliant grip, arm i has a pose
x_i = x + d_i of its own: the one that the virtual link would have if that arm's grip were rigid. In the frame (e1, e2) of
the virtual link the grip is displaced from the beam's end at s_i = ∓L/2 by

    δ1 = e1·d_i + s_i (cos δ3 - 1),      δ2 = e2·d_i + s_i sin δ3,      δ3 = θ_i - θ,

and pulls at it with f = k δ + c δ̇, along, across and turning: from ½Σk δ² and Rayleigh's ½Σc δ̇². It acts on the payload,
which moves alone, with the force f1 e1 + f2 e2 and the moment (s_i + δ1) f2 - δ2 f1 + f3 about its origin, and on arm i with
the opposite force and the moment s_i (cos δ3 f2 - sin δ3 f1) + f3 against it:

    d/dt d_i = ẋ_i - ẋ,        M̄_i(x_i) ẍ_i + C̄_i ẋ_i + Ḡ_i = u_i - φ_i,

so that in `physics.dynamics` the forces of the grips replace M̄_i, C̄_i, Ḡ_i and u_i in the payload's equations. The load of a
grip on the payload is J_iᵀf_i of Eq. (13), and its part beyond an equal share the internal force, as before; for k → ∞ both are
the paper's. With pinned ends f3 turns the virtual link and does not bend the beam, as with the paper's grips.

With rigid grips `Plant.grips` is None, and the loop is compiled without all this.
"""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import inlined
from flexlab.numerics.elementary import sin_cos
from flexlab.numerics.linear_algebra import solve_symmetric
from flexlab.physics.arm import arm_configuration, arm_velocity_terms, joint_torques, task_input

PER_ARM = 6
"""Number of states of each arm: d_i (3), then ẋ_i (3). ∫Σc δ̇² dt, J, follows those of all arms."""


class Grips(NamedTuple):
    """Constants of compliant grips, the same for both arms; along, across, turning."""

    stiffness: np.ndarray
    """k, N/m, N/m, N·m/rad, (3,)."""
    damping: np.ndarray
    """c, N·s/m, N·s/m, N·m·s/rad, (3,)."""
    by_arms: bool
    """Whether a controller measures the mean of the arms' poses, and not the payload's."""
    size: int
    """Number of their states in y."""


class GripScratch(NamedTuple):
    """Quantities of compliant grips at the newest state."""

    pose: np.ndarray
    """x_i, (arms, 3)."""
    trig: np.ndarray
    """cos θ_i, sin θ_i, (arms, 2)."""
    velocity: np.ndarray
    """ẋ_i, (arms, 3)."""
    displacement: np.ndarray
    """δ, (arms, 3)."""
    load: np.ndarray
    """Load of each grip on the payload's pose, (arms, 3)."""
    reaction: np.ndarray
    """φ_i, (arms, 3)."""
    measured: np.ndarray
    """Pose and pose rate that a controller measures, (2, 3)."""
    command: np.ndarray
    """Inputs u at the measured pose, of a law that takes the grips to be rigid, (arms, 3)."""
    inertia: np.ndarray
    """Inertia of arms and payload together, (3, 3)."""
    loss: np.ndarray
    """Σc δ̇², W, (1,)."""


def grip_scratch(arm_count: int, command: np.ndarray) -> GripScratch:
    """Scratch memory for this number of arms."""
    per_arm = [np.zeros((arm_count, width)) for width in (3, 2, 3, 3, 3, 3)]
    return GripScratch(*per_arm, np.zeros((2, 3)), command, np.zeros((3, 3)), np.zeros(1))


def build_grips(grips, arm_count: int) -> Grips | None:
    """`Plant.grips` of a scenario's grips."""
    if not grips.active:
        return None
    stiffness, damping = np.array(grips.stiffness), np.array(grips.damping)
    return Grips(stiffness, damping, grips.measured_at == "arms", PER_ARM * arm_count + 1)


@inlined
def grip_states(grips):
    """Number of the grips' states in y; 0 for rigid ones, a constant at compile time."""
    if grips is None:
        return 0
    return grips.size


@inlined
def carried_arms(grips, arms):
    """Number of arms that move with the payload as one body."""
    return len(arms) if grips is None else 0


@inlined
def own_trig(grips, ws, i):
    """cos and sin of θ_i, the virtual link's angle as seen by arm i."""
    if grips is None:
        return ws.arm.trig[0], ws.arm.trig[1]
    return ws.grips.trig[i, 0], ws.grips.trig[i, 1]


@inlined
def own_rate(grips, ws, i):
    """ẋ_i of arm i."""
    if grips is None:
        return ws.velocity[0], ws.velocity[1], ws.velocity[2]
    return ws.grips.velocity[i, 0], ws.grips.velocity[i, 1], ws.grips.velocity[i, 2]


@inlined
def own_pose(grips, pose, ws, i):
    """x_i of arm i; pose (3,): the payload's."""
    if grips is None:
        return pose[0], pose[1], pose[2]
    return ws.grips.pose[i, 0], ws.grips.pose[i, 1], ws.grips.pose[i, 2]


@inlined
def place_each(grips, arms, gravity, pose, states, later, ws):
    """Fill 𝒥, M̄, Ḡ of every arm at its own pose `later` s from now, at its present rate; returns a fault code.

    pose (3,): the payload's, whose cos θ and sin θ go into ws.arm.trig; states: the grips' states in y.
    """
    s, c = sin_cos(pose[2])
    ws.arm.trig[0], ws.arm.trig[1] = c, s
    own = ws.grips
    for i in range(len(arms)):
        at = PER_ARM * i
        for a in range(3):
            own.velocity[i, a] = states[at + 3 + a]
            own.pose[i, a] = pose[a] + states[at + a] + later * own.velocity[i, a]
        s, c = sin_cos(own.pose[i, 2])
        own.trig[i, 0], own.trig[i, 1] = c, s
        code = arm_configuration(
            arms[i], own.pose[i, 0], own.pose[i, 1], c, s, gravity, ws.arm.M[i], ws.arm.G[i], ws.arm.J[i],
            ws.arm.direction[i],
        )  # fmt: skip
        if code != 0:
            ws.fault[0] = i
            return code
    return 0


@inlined
def place_rigidly(grips, pose, ws):
    """Set every arm's pose to the one with rigid grips at a pose (3,), after `configure_arms` at that pose."""
    if grips is None:
        return
    for i in range(len(ws.grips.pose)):
        for a in range(3):
            ws.grips.pose[i, a] = pose[a]


@inlined
def find_grip_forces(grips, plant, pose, states, ws):
    """Fill the grips' forces and the measured pose, after `find_velocities`; pose (3,) and states: parts of y."""
    if grips is None:
        return
    _find_measured(grips, pose, ws)
    c, s, v, own, loss = ws.arm.trig[0], ws.arm.trig[1], ws.velocity, ws.grips, 0.0
    w, k, b = v[2], grips.stiffness, grips.damping
    for i in range(len(plant.arms)):
        at, side = PER_ARM * i, -0.5 * plant.arms[i].tip * plant.length
        dx, dy, turn = states[at], states[at + 1], states[at + 2]
        sine, cosine = sin_cos(turn)
        along = c * dx + s * dy - side * (sine * sine / (1 + cosine))
        across = c * dy - s * dx + side * sine
        vx, vy, vt = own.velocity[i, 0] - v[0], own.velocity[i, 1] - v[1], own.velocity[i, 2]
        along_rate = c * vx + s * vy - side * (vt * sine) + w * across
        across_rate = c * vy - s * vx + side * (vt * cosine - w) - w * along
        turn_rate = vt - w
        f1, f2 = k[0] * along + b[0] * along_rate, k[1] * across + b[1] * across_rate
        f3 = k[2] * turn + b[2] * turn_rate
        loss += b[0] * (along_rate * along_rate) + b[1] * (across_rate * across_rate) + b[2] * (turn_rate * turn_rate)
        own.displacement[i, 0], own.displacement[i, 1], own.displacement[i, 2] = along, across, turn
        fx, fy = c * f1 - s * f2, s * f1 + c * f2
        own.load[i, 0], own.load[i, 1], own.load[i, 2] = fx, fy, (side + along) * f2 - across * f1 + f3
        own.reaction[i, 0], own.reaction[i, 1] = fx, fy
        own.reaction[i, 2] = side * (cosine * f2 - sine * f1) + f3
    own.loss[0] = loss


@inlined
def _find_measured(grips, pose, ws):
    for a in range(3):
        if grips.by_arms:
            place = rate = 0.0
            for i in range(len(ws.grips.pose)):
                place, rate = place + ws.grips.pose[i, a], rate + ws.grips.velocity[i, a]
            ws.grips.measured[0, a], ws.grips.measured[1, a] = place / len(ws.grips.pose), rate / len(ws.grips.pose)
        else:
            ws.grips.measured[0, a], ws.grips.measured[1, a] = pose[a], ws.velocity[a]


@inlined
def add_grip_loads(grips, ws, force, at):
    """force[at : at + 3] += the load of compliant grips on the payload's pose."""
    if grips is None:
        return
    for i in range(len(ws.grips.load)):
        for a in range(3):
            force[at + a] += ws.grips.load[i, a]


@inlined
def begin_powers(grips, u, ws, power):
    """`power`, W, plus that of inputs u (arms, 3) to arms with compliant grips; sets ws.hand to zero."""
    if grips is None:
        return power
    for i in range(len(u)):
        for a in range(3):
            power += u[i, a] * ws.grips.velocity[i, a]
            ws.hand[i, a] = 0.0
    return power


@inlined
def pull_arm(grips, held, ws, force, at, power):
    """Return `power`, W, plus that of a hand on a link of arm `held`; with rigid grips, add its force to `force` from `at` on."""
    if grips is None:
        for a in range(3):
            force[at + a] += ws.hand[held, a]
            power += ws.hand[held, a] * ws.velocity[a]
    else:
        for a in range(3):
            power += ws.hand[held, a] * ws.grips.velocity[held, a]
    return power


@inlined
def move_arms(grips, u, ws, rates, start):
    """Fill the rates of the grips' states, from `start` on, once inputs u (arms, 3), C̄_i, their forces and ws.hand are known."""
    if grips is None:
        return
    own, b = ws.grips, ws.momentum
    for i in range(len(u)):
        at, v = start + PER_ARM * i, own.velocity[i]
        for a in range(3):
            b[a] = u[i, a] + ws.hand[i, a] - ws.arm.G[i, a] - own.reaction[i, a]
            for other in range(3):
                b[a] -= ws.arm.C[i, a, other] * v[other]
        solve_symmetric(ws.arm.M[i], b)
        for a in range(3):
            rates[at + a], rates[at + 3 + a] = v[a] - ws.velocity[a], b[a]
    rates[start + PER_ARM * len(u)] = own.loss[0]


@inlined
def find_measured_arms(plant, ws):
    """Fill ws.measured_arm, C̄ included, for rigid grips at the measured pose and rate. Returns a fault code."""
    pose, v, seen = ws.grips.measured[0], ws.grips.measured[1], ws.measured_arm
    s, c = sin_cos(pose[2])
    seen.trig[0], seen.trig[1] = c, s
    for i in range(len(plant.arms)):
        arm = plant.arms[i]
        code = arm_configuration(
            arm, pose[0], pose[1], c, s, plant.gravity, seen.M[i], seen.G[i], seen.J[i], seen.direction[i]
        )
        if code != 0:
            ws.fault[0] = i
            return code
        arm_velocity_terms(arm, c, s, v[0], v[1], v[2], seen.J[i], seen.direction[i], seen.C[i])
    return 0


@inlined
def pass_on(arms, ws):
    """Fill ws.u with the inputs at the arms' poses that have the joint torques of ws.grips.command at the measured pose."""
    seen = ws.measured_arm
    for i in range(len(arms)):
        joint_torques(arms[i], seen.trig[0], seen.trig[1], seen.direction[i], ws.grips.command[i], ws.tau)
        task_input(ws.arm.J[i], ws.tau, ws.u[i])


@inlined
def whole_inertia(arms, ws):
    """Fill ws.grips.inertia with S of arms and payload for rigid grips."""
    for a in range(3):
        for b in range(3):
            ws.grips.inertia[a, b] = ws.S[a, b]
            for i in range(len(arms)):
                ws.grips.inertia[a, b] += ws.arm.M[i, a, b]


@inlined
def grip_forms(arm, length, c, s, of, form):
    """Add the stiffness or damping `of` (3,) of one arm's grip, in the pose's coordinates at δ = 0, to form (3, 3)."""
    side = -0.5 * arm.tip * length
    for k in range(3):
        x, y, t = (c, s, 0.0) if k == 0 else (-s, c, side) if k == 1 else (0.0, 0.0, 1.0)
        for a in range(3):
            for b in range(3):
                first, second = x if a == 0 else y if a == 1 else t, x if b == 0 else y if b == 1 else t
                form[a, b] += of[k] * (first * second)


def begin_grips(plant, states: np.ndarray, rate: np.ndarray) -> None:
    """Start compliant grips without displacement, at the payload's pose rate (3,); states: the grips' states in y."""
    for i in range(len(plant.arms)):
        states[PER_ARM * i : PER_ARM * (i + 1)] = [0.0, 0.0, 0.0, *rate]


def arm_poses(plant, pose: np.ndarray, states: np.ndarray) -> np.ndarray:
    """x_i of every arm, (arms, 3); pose (3,): the payload's; states: the grips' states in y."""
    return pose + states[: PER_ARM * len(plant.arms)].reshape(-1, PER_ARM)[:, :3]


def measured_motion(plant, y: np.ndarray, states: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pose and pose rate that a controller measures, (3,) each; rate (3,): the payload's; states: the grips' states in y."""
    if not plant.grips.by_arms:
        return y[:3].copy(), rate
    rates = states[: PER_ARM * len(plant.arms)].reshape(-1, PER_ARM)[:, 3:]
    return arm_poses(plant, y[:3], states).mean(axis=0), rates.mean(axis=0)
