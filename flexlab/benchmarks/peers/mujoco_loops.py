"""Compiled loops around MuJoCo's C functions: the control law's torques in, joint coordinates out."""

from typing import Any

import numba
import numpy as np

from flexlab.benchmarks.peers.peer_law import joint_torque_law


@numba.njit(error_model="numpy")
def set_torques(system, ws, geometry, t, position, velocity, memory, force, tau, motion):
    """Fill generalized forces (all joints) with the law's torques; motion: scratch (2, 3), row 0 becomes the pose.

    geometry: both link lengths, wrist to payload's origin, base x, base y of the left arm, m (5,).
    """
    first = position[0]
    second = first + position[1]
    theta = second + position[2]
    first_rate, second_rate = velocity[0], velocity[0] + velocity[1]
    l1, l2, middle = geometry[0], geometry[1], geometry[2]
    x, v = motion[0], motion[1]
    v[2] = second_rate + velocity[2]
    x[0] = geometry[3] + l1 * np.cos(first) + l2 * np.cos(second) + middle * np.cos(theta)
    x[1] = geometry[4] + l1 * np.sin(first) + l2 * np.sin(second) + middle * np.sin(theta)
    x[2] = theta
    v[0] = -l1 * np.sin(first) * first_rate - l2 * np.sin(second) * second_rate - middle * np.sin(theta) * v[2]
    v[1] = l1 * np.cos(first) * first_rate + l2 * np.cos(second) * second_rate + middle * np.cos(theta) * v[2]
    code = joint_torque_law(system, t, x, v, memory, ws, tau)
    # The right arm's third joint acts between its second link and the carrier, which is the end of the left arm.
    wrist, right = tau[1, 2], len(force) - 2
    for joint in range(3):
        force[joint] = tau[0, joint] + wrist
    force[right], force[right + 1] = tau[1, 0] - wrist, tau[1, 1] - wrist
    return code


def step_loop(mj_step: Any) -> Any:
    """The loop over MuJoCo's own integrators: torques are held during a step, the memory takes explicit Euler steps."""

    @numba.njit(error_model="numpy")
    def run(model, data, position, velocity, acceleration, force, system, ws, geometry, dt, steps, rows):
        memory, tau, motion = np.zeros(3), np.zeros((2, 3)), np.zeros((2, 3))
        for i in range(len(rows)):
            for j in range(steps):
                t = (i * steps + j) * dt
                set_torques(system, ws, geometry, t, position, velocity, memory, force, tau, motion)
                mj_step(model, data)
                for a in range(3):
                    memory[a] += dt * ws.memory_rate[a]
            set_torques(system, ws, geometry, (i + 1) * steps * dt, position, velocity, memory, force, tau, motion)
            rows[i, :3] = motion[0]
            rows[i, 3:] = position[3:-2]

    return run


def rk4_loop(mj_forward: Any) -> Any:
    """The loop of the classical Runge-Kutta method over MuJoCo's accelerations."""

    @numba.njit(error_model="numpy")
    def run(model, data, position, velocity, acceleration, force, system, ws, geometry, dt, steps, rows):
        n, tau, motion, memory = len(position), np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(3)
        y, k, total = np.zeros(2 * n + 3), np.zeros(2 * n + 3), np.zeros(2 * n + 3)
        for i in range(len(rows)):
            for j in range(steps):
                y[:n], y[n : 2 * n], y[2 * n :] = position, velocity, memory
                total[:] = 0.0
                for stage in range(4):
                    reach = 0.0 if stage == 0 else (dt if stage == 3 else dt / 2)
                    for a in range(n):
                        position[a], velocity[a] = y[a] + reach * k[a], y[n + a] + reach * k[n + a]
                    for a in range(3):
                        memory[a] = y[2 * n + a] + reach * k[2 * n + a]
                    t = (i * steps + j) * dt + reach
                    set_torques(system, ws, geometry, t, position, velocity, memory, force, tau, motion)
                    mj_forward(model, data)
                    k[:n], k[n : 2 * n], k[2 * n :] = velocity, acceleration, ws.memory_rate
                    total += (2.0 if stage == 1 or stage == 2 else 1.0) * k
                y += dt / 6 * total
                position[:], velocity[:], memory[:] = y[:n], y[n : 2 * n], y[2 * n :]
            set_torques(system, ws, geometry, (i + 1) * steps * dt, position, velocity, memory, force, tau, motion)
            rows[i, :3] = motion[0]
            rows[i, 3:] = position[3:-2]

    return run


def held_loop(mj_step: Any) -> Any:
    """The loop of a digital controller: torques are held, and the memory takes an explicit Euler step, for a whole tick."""

    @numba.njit(error_model="numpy")
    def run(model, data, position, velocity, acceleration, force, system, ws, geometry, dt, steps, rows):
        memory, tau, motion = np.zeros(3), np.zeros((2, 3)), np.zeros((2, 3))
        for i in range(len(rows) + 1):
            set_torques(system, ws, geometry, i * steps * dt, position, velocity, memory, force, tau, motion)
            if i > 0:
                rows[i - 1, :3] = motion[0]
                rows[i - 1, 3:] = position[3:-2]
            if i < len(rows):
                for a in range(3):
                    memory[a] += steps * dt * ws.memory_rate[a]
                for _ in range(steps):
                    mj_step(model, data)

    return run
