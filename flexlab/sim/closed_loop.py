"""Plant and control law closed into one right-hand side, the thing that every integrator calls."""

import threading
from typing import NamedTuple

import numpy as np

from flexlab.compiled import compiled, inlined
from flexlab.control.law_kernels import Control, control_law
from flexlab.control.load_sharing import feed_forward_bending
from flexlab.control.motion import DesiredMotion, desired_motion
from flexlab.physics.arm import arm_velocity_terms, joint_torques, task_input
from flexlab.physics.axial_load import find_axial_load, has_axial_load
from flexlab.physics.dynamics import find_velocities, momentum_rates
from flexlab.physics.joints import compensate_friction, joint_parts, turn_joints
from flexlab.physics.mass_change import find_mass
from flexlab.physics.plant import (
    G,
    Plant,
    Workspace,
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
    plant, control = system.plant, system.control
    return make_workspace(
        len(plant.arms), plant.modal.shape[1], control.memory_size, control.signal_count, plant.own_size
    )


_scratch = threading.local()


def scratch_workspace(system: System) -> Workspace:
    """A workspace of this thread's own for a call that ends before the next one is asked for: making one takes 50 µs."""
    plant, control = system.plant, system.control
    sizes = (len(plant.arms), plant.modal.shape[1], control.memory_size, control.signal_count, plant.own_size)
    if getattr(_scratch, "sizes", None) != sizes:
        _scratch.workspace, _scratch.sizes = new_workspace(system), sizes
    _scratch.workspace.desired_time[0] = np.nan
    return _scratch.workspace


def state_length(system: System) -> int:
    """Length of the state y of a system."""
    plant, control = system.plant, system.control
    return state_size(plant.modal.shape[1], control.memory_size, control.signal_count, plant.own_size)


def memory_slice(system: System) -> slice:
    """Where in y the law's memory stands."""
    start = state_size(system.plant.modal.shape[1], 0, 0, system.plant.own_size)
    return slice(start, start + system.control.memory_size)


def own_parts(plant: Plant) -> dict[str, slice]:
    """Where among the joints' and the material's states each part of them stands, by name."""
    parts, end = joint_parts(plant.joints), plant.joint_size
    return parts if plant.mass_change is None else {**parts, "material": slice(end, end + 1)}


def joint_states_of(system: System, y: np.ndarray) -> dict[str, np.ndarray]:
    """Views of the named parts of the joints' states in y, and of the energy that material brought."""
    start = state_size(system.plant.modal.shape[1], 0)
    own = y[start : start + system.plant.own_size]
    return {name: own[part] for name, part in own_parts(system.plant).items()}


@inlined
def law_places(system):
    """Where in y the law's memory begins, and where it ends and the law's own signals begin.

    The signals are of this state under continuous control, of the last control instant otherwise.
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
    """Fill C̄_i, the desired motion, u and the memory's rates after `find_velocities`; of joints that are not ideal theirs."""
    find_asked_inputs(system, t, y, ws)
    turn_joints(system.plant.joints, system.plant.arms, y[joints_start(system.plant) :], ws)


@inlined
def find_asked_inputs(system, t, y, ws):
    """As `find_inputs`, of what motors are asked for."""
    plant, control = system.plant, system.control
    c, s, v = ws.arm.trig[0], ws.arm.trig[1], ws.velocity
    for i in range(len(plant.arms)):
        arm_velocity_terms(plant.arms[i], c, s, v[0], v[1], v[2], ws.arm.J[i], ws.arm.direction[i], ws.arm.C[i])
    if ws.desired_time[0] != t:
        desired_motion(system.trajectory, t, ws.desired)
        ws.desired_time[0] = t
    if control.sampled:
        for i in range(len(plant.arms)):
            task_input(ws.arm.J[i], system.held_torque[i], ws.u[i])
        for a in range(control.memory_size):
            ws.memory_rate[a] = 0.0
        return
    start, end = law_places(system)
    ws.truth[0].time = t
    control_law(
        control,
        plant.gravity,
        y[0:3],
        v,
        ws.beam_rate,
        ws.desired,
        ws.truth[0],
        y[start:end],
        ws.memory_rate,
        y[end:],
    )
    if system.trajectory.bending != 0:
        feed_forward_bending(system.trajectory.bending, control.payload, ws.truth[0])
    compensate_friction(plant.joints, plant.arms, ws.arm, v[0], v[1], v[2], ws.u, ws.tau)
    if control.limited:
        for i in range(len(plant.arms)):
            joint_torques(plant.arms[i], c, s, ws.arm.direction[i], ws.u[i], ws.tau)
            limit_torques(control.torque_limit, ws.tau)
            task_input(ws.arm.J[i], ws.tau, ws.u[i])


@inlined
def find_state(system, t, y, ws):
    """Velocities, arm terms, inputs and w̄ of state y at time t, in ws; returns a fault code."""
    plant = system.plant
    find_mass(plant.mass_change, t, ws)
    code, ws.w_bar[0], w_bar_rate = find_velocities(plant, y, ws)
    if code != 0:
        return code
    g_rate = 0.0
    for k in range(plant.modal.shape[1]):
        g_rate += plant.modal[G, k] * ws.eta_dot[k]
    ws.beam_rate[0], ws.beam_rate[1] = w_bar_rate, g_rate
    find_inputs(system, t, y, ws)
    return code


@inlined
def rates(system, t, y, ws, dy, whole):
    """dy/dt of the closed loop; `whole` as in `momentum_rates`. Returns a fault code of `arm_configuration`."""
    code = find_state(system, t, y, ws)
    if code != 0:
        return code
    if has_axial_load(system.plant):
        find_axial_load(system.plant, y, ws)
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
