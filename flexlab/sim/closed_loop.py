"""The closed loop of plant and control law: the right-hand side that every integrator calls."""

import threading
from typing import Any, NamedTuple

import numpy as np

from flexlab.compiled import compiled, inlined
from flexlab.control.law_kernels import Control, control_law, feed_forward_bending
from flexlab.control.motion import DesiredMotion, desired_motion
from flexlab.physics.arm import arm_velocity_terms, joint_torques, task_input
from flexlab.physics.axial_load import find_axial_load
from flexlab.physics.dynamics import find_velocities, momentum_rates
from flexlab.physics.grips import find_grip_forces, find_measured_arms, own_rate, own_trig, pass_on
from flexlab.physics.joints import compensate_friction, joint_parts, turn_joints
from flexlab.physics.mass_change import believed_mass, find_mass
from flexlab.physics.plant import (
    G,
    Plant,
    Workspace,
    grips_start,
    joint_states,
    joints_start,
    make_workspace,
    memory_start,
    state_size,
)


class System(NamedTuple):
    """Everything constant between two commands."""

    plant: Plant
    control: Control
    trajectory: DesiredMotion
    held_torque: np.ndarray
    """Joint torques that a sampled controller holds, N·m, (arms, 3)."""


def new_workspace(system: System) -> Workspace:
    """Scratch memory for the kernels of a system."""
    return make_workspace(*_sizes(system))


def _sizes(system: System) -> tuple[int, int, int, int, int]:
    """Numbers of arms and modes, and lengths of the controller's state, of its signals and of the plant's own states."""
    plant, control = system.plant, system.control
    return len(plant.arms), plant.modal.shape[1], control.memory_size, control.signal_count, plant.own_size


_scratch = threading.local()


def scratch_workspace(system: System) -> Workspace:
    """This thread's shared workspace, valid until the next call of this function: making a new one takes 50 µs."""
    sizes = _sizes(system)
    if getattr(_scratch, "sizes", None) != sizes:
        _scratch.workspace, _scratch.sizes = new_workspace(system), sizes
    _scratch.workspace.desired_time[0] = np.nan
    return _scratch.workspace


def state_length(system: System) -> int:
    """Length of the state y of a system."""
    return state_size(*_sizes(system)[1:])


def memory_slice(system: System) -> slice:
    """The place of the controller's state in y."""
    start = state_size(system.plant.modal.shape[1], 0, 0, system.plant.own_size)
    return slice(start, start + system.control.memory_size)


def own_parts(plant: Plant) -> dict[str, slice]:
    """The slices of the joints', the material's and the grips' states among the plant's own states, by name."""
    parts, end = joint_parts(plant.joints), plant.joint_size
    if plant.mass_change is not None:
        parts, end = {**parts, "material": slice(end, end + 1)}, end + 1
    return parts if plant.grips is None else {**parts, "grips": slice(end, end + plant.grips.size)}


def own_states_of(system: System, y: np.ndarray) -> dict[str, np.ndarray]:
    """Views of the parts of `own_parts` in y, by name."""
    start = state_size(system.plant.modal.shape[1], 0)
    own = y[start : start + system.plant.own_size]
    return {name: own[part] for name, part in own_parts(system.plant).items()}


def law_input_at(system: System, x: np.ndarray, v: np.ndarray, desired: np.ndarray, ws: Workspace) -> Any:
    """Fill the `LAW_INPUT` record of `ws`, all but q̇, for a pose x (3,) and its rate v (3,); desired (3, 3).

    Call `configure_arms` at that pose and `find_mass_at` before.
    """
    plant, payload, now = system.plant, system.control.payload, ws.truth[0]
    c, s = ws.arm.trig
    for i in range(len(plant.arms)):
        arm_velocity_terms(plant.arms[i], c, s, *v, ws.arm.J[i], ws.arm.direction[i], ws.arm.C[i])
    now.x[:], now.v[:], now.desired[:] = x, v, desired
    factor, now.growth = believed_mass(plant.mass_change, payload.change, ws)
    now.gravity, now.m, now.I = plant.gravity, factor * payload.m, factor * payload.I
    now.kappa[:], now.share[:] = factor * payload.kappa, system.control.share
    return now


@inlined
def law_places(system):
    """Where the controller's state begins in y, and where it ends and the law's own signals begin.

    Under continuous control the signals belong to this state, otherwise to the last control instant.
    """
    start = memory_start(system.plant)
    return start, start + system.control.memory_size


@inlined
def limit_torques(limit, tau):
    """Clip joint torques (3,) to their limits (3,)."""
    for joint in range(3):
        if abs(tau[joint]) > limit[joint]:
            tau[joint] = np.copysign(limit[joint], tau[joint])


@inlined
def find_inputs(system, t, y, ws):
    """Fill C̄_i, the desired motion, u and the rates of controller and joints, after `find_velocities`."""
    find_commanded_inputs(system, t, y, ws)
    turn_joints(system.plant.joints, system.plant.grips, system.plant.arms, y[joints_start(system.plant) :], ws)


@inlined
def find_commanded_inputs(system, t, y, ws):
    """As `find_inputs`, but with the inputs that the motors are asked for."""
    plant, control = system.plant, system.control
    for i in range(len(plant.arms)):
        c, s = own_trig(plant.grips, ws, i)
        vx, vy, w = own_rate(plant.grips, ws, i)
        arm_velocity_terms(plant.arms[i], c, s, vx, vy, w, ws.arm.J[i], ws.arm.direction[i], ws.arm.C[i])
    if ws.desired_time[0] != t:
        desired_motion(system.trajectory, t, ws.desired)
        ws.desired_time[0] = t
    if control.sampled:
        for i in range(len(plant.arms)):
            task_input(ws.arm.J[i], system.held_torque[i], ws.u[i])
        for a in range(control.memory_size):
            ws.memory_rate[a] = 0.0
        return
    _run_law(plant.grips, system, t, y, ws)


@inlined
def _run_law(grips, system, t, y, ws):
    """Let the law fill u; it assumes rigid grips."""
    if grips is None:
        _run_law_at(system, t, y, y[0:3], ws.velocity, ws.truth[0], ws.arm, ws.u, ws)
    else:
        measured = ws.grips.measured
        _run_law_at(system, t, y, measured[0], measured[1], ws.measured[0], ws.measured_arm, ws.grips.command, ws)
        pass_on(system.plant.arms, ws)


@inlined
def _run_law_at(system, t, y, x, v, now, terms, u, ws):
    """Fill u (arms, 3), a view of the law's record `now`, and the controller's rates, for the pose x and its rate v.

    `terms`: the arm terms of `now`.
    """
    plant, control = system.plant, system.control
    start, end = law_places(system)
    now.time = t
    mass = believed_mass(plant.mass_change, control.payload.change, ws)
    control_law(
        control, plant.gravity, mass, x, v, ws.beam_rate, ws.desired, now, y[start:end], ws.memory_rate, y[end:]
    )
    if control.drives:
        if system.trajectory.bending != 0:
            feed_forward_bending(system.trajectory.bending, now)
        compensate_friction(plant.joints, plant.arms, terms, v[0], v[1], v[2], u, ws.tau)
    if control.limited:
        for i in range(len(plant.arms)):
            joint_torques(plant.arms[i], terms.trig[0], terms.trig[1], terms.direction[i], u[i], ws.tau)
            limit_torques(control.torque_limit, ws.tau)
            task_input(terms.J[i], ws.tau, u[i])


@inlined
def _see(grips, system, ws):
    """Fill ws.measured_arm for a continuous law, which assumes rigid grips; returns a fault code."""
    if grips is None:
        return 0
    if system.control.sampled:
        return 0
    return find_measured_arms(system.plant, ws)


@inlined
def find_state(system, t, y, ws):
    """Fill ws with velocities, arm terms, inputs and w̄ of state y at time t; returns a fault code."""
    plant = system.plant
    find_mass(plant.mass_change, t, ws)
    code, ws.w_bar[0], w_bar_rate = find_velocities(plant, y, ws)
    if code != 0:
        return code
    g_rate = 0.0
    for k in range(plant.modal.shape[1]):
        g_rate += plant.modal[G, k] * ws.eta_dot[k]
    ws.beam_rate[0], ws.beam_rate[1] = w_bar_rate, g_rate
    find_grip_forces(plant.grips, plant, y[0:3], y[grips_start(plant) :], ws)
    code = _see(plant.grips, system, ws)
    if code != 0:
        return code
    find_inputs(system, t, y, ws)
    return code


@inlined
def rates(system, t, y, ws, dy, whole):
    """Fill dy with dy/dt of the closed loop; `whole` as in `momentum_rates`. Returns a fault code of `arm_configuration`."""
    code = find_state(system, t, y, ws)
    if code != 0:
        return code
    find_axial_load(system.plant.axial, system.plant, y, ws)
    momentum_rates(system.plant, y, ws.w_bar[0], ws.beam_rate[0], ws.u, ws, dy, whole)
    joints, start = joints_start(system.plant), memory_start(system.plant)
    for a in range(joint_states(system.plant.joints)):
        dy[joints + a] = ws.joint_rate[a]
    for a in range(system.control.memory_size):
        dy[start + a] = ws.memory_rate[a]
    return code


@compiled
def rates_at(system, t, y, ws, dy, whole):
    """`rates` for Python."""
    return rates(system, t, y, ws, dy, whole)
