"""Many worlds in one call: each takes its action, moves by one control period, and gives its observation and reward.

A world is a row of arrays; its beam is one of the variants that were computed beforehand. The worlds of one thread share a
workspace, which keeps nothing from one call of `advance` to the next.
"""

from typing import NamedTuple

import numpy as np

from flexlab.compiled import compiled, inlined, pluggable
from flexlab.physics.arm import joint_angles, joint_torques
from flexlab.physics.dynamics import configure_arms, set_momenta
from flexlab.physics.plant import ETA, Plant
from flexlab.sim.advance import advance
from flexlab.sim.closed_loop import System, limit_torques
from flexlab.sim.integrators.scheme import Etdrk4
from flexlab.sim.sampled_control import gaussian
from flexlab.sim.signals import ANGLE, ARMS, MIDSPAN, PER_ARM, POSE, QUASI_STATIC

OBSERVED = 14
"""Number of values in an observation."""
POSITION_SCALE, ANGLE_SCALE, VIBRATION_SCALE = 0.01, 0.02, 0.001
"""Errors that cost 1 per second, m, rad, m."""
EFFORT = 0.01
"""Cost per second of a joint torque at its limit."""


class Variants(NamedTuple):
    """The beams that worlds may have, stacked: everything that depends on EI."""

    modal: np.ndarray
    """(variants, 13, n_m)."""
    damping: np.ndarray
    """(variants, n_m, n_m)."""
    kappa: np.ndarray
    """(variants, 3)."""
    shapes: np.ndarray
    """(variants, n_q, n_m)."""
    compliance: np.ndarray
    """(variants, 2)."""
    buckling_load: np.ndarray
    """(variants,)."""
    axial: np.ndarray | None
    """(variants, 4, n_f, n_f); None as in `Plant.axial`."""
    etdrk4: Etdrk4
    """Each array with an axis (variants,) before its own."""
    step_count: np.ndarray
    """Integration steps per control period, (variants,)."""


class Worlds(NamedTuple):
    """The state of each world, by row."""

    variant: np.ndarray
    y: np.ndarray
    good: np.ndarray
    """Scratch, like y."""
    held: np.ndarray
    """Joint torques in force, N·m, (worlds, arms, 3)."""
    line: np.ndarray
    """Torques on their way, (worlds, longest delay + 1, arms, 3)."""
    delay: np.ndarray
    tick: np.ndarray
    seed: np.ndarray
    """Seed of the measurement noise."""
    noise: np.ndarray
    """Scale of the noise."""
    offset: np.ndarray
    """Start pose minus that of the path, (worlds, 3)."""
    pause: np.ndarray
    """Whether the world begins anew in this call instead of moving."""
    row: np.ndarray
    """A sample, (worlds, 1, row length)."""
    observation: np.ndarray
    """(worlds, OBSERVED), float32."""
    reward: np.ndarray
    failed: np.ndarray
    over: np.ndarray


@inlined
def _axial_of(axial, v):
    """`Plant.axial` of variant v."""
    if axial is None:
        return None
    return axial[v]


@inlined
def _with_beam(plant, variants, v):
    """The plant with the beam of variant v."""
    return Plant(
        plant.arms, plant.m, plant.I, plant.gravity, variants.modal[v], variants.damping[v], plant.block_start,
        variants.kappa[v], variants.shapes[v], variants.compliance[v], plant.pull, plant.length,
        variants.buckling_load[v], _axial_of(variants.axial, v), plant.joints, plant.mass_change, plant.grips,
    )  # fmt: skip


@inlined
def _begin_row(plant, y, row, ws):
    """Fill in the part of a sample that is drawn: time, pose, joint angles, a straight beam."""
    for k in range(len(row)):
        row[k] = 0.0
    for a in range(3):
        row[POSE + a] = y[a]
    if configure_arms(plant, y[0:3], ws.measured_arm, ws.fault) == 0:
        for i in range(len(plant.arms)):
            first = ARMS + PER_ARM * i + ANGLE
            joint_angles(y[2], plant.arms[i], ws.measured_arm.direction[i], row[first : first + 3])


@compiled
def begin_worlds(plant, variants, worlds, start, desired, ws):
    """Set the worlds that pause to their start: pose and pose rate `start` (2, 3), with their offset added to the pose.

    `desired` (3, 3): x_d, ẋ_d, ẍ_d at t = 0.
    """
    n = plant.modal.shape[1]
    for w in range(len(worlds.tick)):
        if not worlds.pause[w]:
            continue
        v, y = worlds.variant[w], worlds.y[w]
        own = _with_beam(plant, variants, v)
        for k in range(len(y)):
            y[k] = 0.0
        for k in range(ETA + 2 * n, ETA + 3 * n + 3):
            y[k] = np.nan
        for a in range(3):
            y[a] = start[0, a] + worlds.offset[w, a]
        for k in range(n):
            ws.eta_dot[k] = 0.0
        set_momenta(own, y, start[1], ws.eta_dot, ws)
        worlds.tick[w] = 0
        for i in range(worlds.held.shape[1]):
            for joint in range(3):
                worlds.held[w, i, joint] = 0.0
                for place in range(worlds.line.shape[1]):
                    worlds.line[w, place, i, joint] = 0.0
        worlds.reward[w], worlds.failed[w], worlds.over[w] = 0.0, False, False
        _begin_row(own, y, worlds.row[w, 0], ws)
        seen = worlds.observation[w]
        for a in range(3):
            seen[a], seen[3 + a] = y[a] - desired[0, a], start[1, a] - desired[1, a]
            seen[6 + a], seen[11 + a] = desired[2, a], y[a]
        seen[9] = seen[10] = 0.0


@pluggable
def step_worlds(
    system,
    sampling,
    watch,
    variants,
    worlds,
    actions,
    by_wrench,
    limits,
    noise,
    period,
    ticks,
    bend_limit,
    worst,
    rooted,
    level,
    first,
    ws,
):
    """Move the worlds that do not pause by one control period under actions (worlds, 3 or 3 per arm), N and N·m.

    `limits` (3,): largest joint torques; `noise` (8,): standard deviations of e, ė, hᵀq̇ and gᵀq̇; `worst`, `rooted`: as in
    `worlds.Rules`; `level`, `first`: 0, False. Returns 0.
    """
    plant, arm_count = system.plant, len(system.plant.arms)
    for w in range(len(worlds.tick)):
        if worlds.pause[w]:
            continue
        v, y, held, line = worlds.variant[w], worlds.y[w], worlds.held[w], worlds.line[w]
        own = _with_beam(plant, variants, v)
        moving = System(own, system.control, system.trajectory, held)
        all_etdrk4 = variants.etdrk4
        etdrk4 = Etdrk4(all_etdrk4.operators[v], all_etdrk4.forced[v], all_etdrk4.soft_modes[v], all_etdrk4.flow[v])
        code = configure_arms(own, y[0:3], ws.measured_arm, ws.fault)
        c, s, effort = ws.measured_arm.trig[0], ws.measured_arm.trig[1], 0.0
        for i in range(arm_count):
            if by_wrench:
                for a in range(3):
                    ws.u[i, a] = system.control.share[i] * actions[w, a]
                joint_torques(plant.arms[i], c, s, ws.measured_arm.direction[i], ws.u[i], ws.tau)
            else:
                for joint in range(3):
                    ws.tau[joint] = actions[w, 3 * i + joint]
            limit_torques(limits, ws.tau)
            for joint in range(3):
                for place in range(worlds.delay[w]):
                    line[place, i, joint] = line[place + 1, i, joint]
                line[worlds.delay[w], i, joint] = ws.tau[joint]
                held[i, joint] = line[0, i, joint]
                share = held[i, joint] / limits[joint]
                effort += share * share
        tick = worlds.tick[w]
        if code == 0:
            _, code = advance(
                moving, sampling, etdrk4, None, None, watch, level, bend_limit, 0.0, tick, period,
                variants.step_count[v], y, worlds.good[w], ws, worlds.row[w], first,
            )  # fmt: skip
        worlds.tick[w] = tick + 1
        worlds.over[w] = tick + 1 >= ticks
        if code != 0:
            worlds.failed[w], worlds.over[w] = True, False
            worlds.reward[w] = -worst * period * (ticks - tick)
            continue
        seen, row, cost = worlds.observation[w], worlds.row[w, 0], 0.0
        scale, seed, instant = worlds.noise[w], worlds.seed[w], tick + 1
        for a in range(3):
            error, rate = y[a] - ws.desired[0, a], ws.velocity[a] - ws.desired[1, a]
            scaled = error / (ANGLE_SCALE if a == 2 else POSITION_SCALE)
            cost += scaled * scaled
            if scale > 0:
                error += scale * noise[a] * gaussian(seed, instant, a)
                rate += scale * noise[3 + a] * gaussian(seed, instant, 3 + a)
            seen[a], seen[3 + a], seen[6 + a] = error, rate, ws.desired[2, a]
            seen[11 + a] = error + ws.desired[0, a]
        for a in range(2):
            moment = ws.beam_rate[a]
            if scale > 0:
                moment += scale * noise[6 + a] * gaussian(seed, instant, 6 + a)
            seen[9 + a] = moment
        ringing = (row[MIDSPAN] - row[QUASI_STATIC]) / VIBRATION_SCALE
        cost += ringing * ringing + EFFORT * effort
        worlds.reward[w] = -period * min(np.sqrt(cost) if rooted else cost, worst)
    return np.int64(0)
