"""The engine's inner loop: whole ticks of equal steps, one sample row per tick, no allocation, no global lock."""

import numpy as np

from flexlab.compiled import compiled, inlined
from flexlab.physics.arm import NOT_A_NUMBER
from flexlab.physics.energy import elastic_energy, gravity_energy, kinetic_energy
from flexlab.physics.hand import beam_is_held
from flexlab.physics.mass_change import mass_factor
from flexlab.physics.plant import AXIAL_WORK, BEND, DISSIPATED, ETA, WORK
from flexlab.sim.closed_loop import find_state, law_places, rates
from flexlab.sim.integrators.beam_flow import TICKS, end_flow, meet_acceleration, note_beginning, note_rates
from flexlab.sim.integrators.etdrk4 import FREE, bend_flow
from flexlab.sim.integrators.generalized_alpha import follow_jump
from flexlab.sim.integrators.scheme import STATE
from flexlab.sim.integrators.step import rates_row, stage_count, stage_instant, take_stage
from flexlab.sim.sampled_control import act_at_instant
from flexlab.sim.signals import write_sample
from flexlab.sim.step_levels import wanted_level

DIVERGED, BENT = NOT_A_NUMBER, 4
"""Fault codes of the loop besides those of `physics.arm`: a state diverged; the deflection is as large as the beam."""
INTERRUPTED = 5
"""Not a fault: the loop returned early, somewhere within a tick, because `Workspace.interrupt` was set."""
OTHER_STEP = 100
"""Not a fault: the next tick wants the step of level code - OTHER_STEP."""
SAME_INSTANT = 1e-11
"""Time, s: a discontinuity this close to the end of a step or to another one is taken to be there. Nothing moves in that time,
and no step gets so short that differences over it are lost in rounding."""
RUNAWAY = 1e9
"""A state beyond this, in its SI unit, has diverged."""


@inlined
def diverged(system, y):
    """Whether a pose, momentum, energy or controller state is not finite or beyond `RUNAWAY`."""
    for i in range(ETA):
        if not abs(y[i]) < RUNAWAY:
            return True
    start, end = law_places(system)
    for i in range(start, end):
        if not abs(y[i]) < RUNAWAY:
            return True
    return False


@inlined
def energy_beyond_work(plant, y, ws):
    """Energy of arms and payload less the work done on them, J, after `find_state` of y: what it loses is dissipated."""
    factor = mass_factor(plant.mass_change, ws)
    stored = kinetic_energy(y, ws.velocity, ws.eta_dot, factor) + elastic_energy(plant, y)
    return stored + gravity_energy(plant, y, ws.w_bar[0], factor, ws) - y[WORK] - y[AXIAL_WORK]


@inlined
def copy(source, target):
    """target = source, (n,)."""
    for i in range(len(target)):
        target[i] = source[i]


@inlined
def is_discontinuous(path, t):
    """Whether the desired velocity, acceleration or jerk jumps at time t, s."""
    place = np.searchsorted(path.discontinuities, t - SAME_INSTANT)
    return place < len(path.discontinuities) and path.discontinuities[place] < t + SAME_INSTANT


@inlined
def largest_deflection(plant, y):
    """|w| at mid-span, or at the free end, m."""
    w = 0.0
    for k in range(plant.modal.shape[1]):
        w += plant.modal[BEND, k] * y[ETA + k]
    return abs(w)


@compiled
def advance(
    system,
    sampling,
    etdrk4,
    generalized_alpha,
    rk4,
    watch,
    level,
    deflection_limit,
    origin,
    tick,
    tick_period,
    step_count,
    y,
    good,
    ws,
    rows,
    first_is_present,
):
    """Advance y from tick number `tick` by one tick of `step_count` steps per row, filling rows (ticks, row_length).

    Tick 0 is at `origin`, s: the run's start, or the beginning of a part of a split tick (`sim.stepping`). With
    `first_is_present` the first row is the present instant. Control instants lie on steps. Returns the ticks done and a code:
    0, `INTERRUPTED`, a fault, or `OTHER_STEP` plus the level that the next tick wants if that is not `level`. On a fault y is set
    back to the last good tick; `good` is scratch like y.
    """
    # The rates at a tick serve its sample and the step that follows. They are computed in one place for all stages: the same
    # machine code gives the same bits whatever the block sizes, and there is less of it to compile.
    dt = tick_period / step_count
    row = 0 if first_is_present else -1
    # Not the literal 0, for which numba would compile kernels once more.
    done = j = stage = np.int64(0)
    n = system.plant.modal.shape[1]
    true_rate = y[ETA + 2 * n + 3 : ETA + 3 * n + 3]
    # Nor the literal True.
    flows, stepped, whole, unspent = False, False, etdrk4 is None, 0.0
    if etdrk4 is not None:
        flows = etdrk4.flow.shape[1] > 0
    while True:
        t = origin + (tick + done) * tick_period + j * dt
        state = y if stage == 0 else ws.stage[STATE]
        code = rates(
            system,
            stage_instant(generalized_alpha, stage, t, dt, system.trajectory.inside),
            state,
            ws,
            ws.stage[rates_row(etdrk4, stage)],
            whole,
        )
        if stage == 0:
            if etdrk4 is not None:
                last = j == step_count - 1
                if code == 0 and flows and beam_is_held(system.plant):
                    before, unspent = unspent, energy_beyond_work(system.plant, y, ws)
                    if stepped:
                        y[DISSIPATED] += before - unspent
                if code == 0 and flows and stepped:
                    bend_flow(system.plant, etdrk4, ws)
                    jumps = system.control.sampled or system.trajectory.inside > 0
                    before_jump = ws.u_before if jumps else ws.u
                    end_flow(system.plant, etdrk4.flow, dt, ws.stage[FREE], before_jump, y, ws)
                    if j == 0:
                        since = ETA + 2 * n + TICKS
                        y[since] = y[since] + 1 if y[since] >= 1 else 1.0
                    # At a sample, and at the beginning of the step that leads to it.
                    if j == 0 or last:
                        note_rates(system.plant, etdrk4.flow, dt, ws.stage[FREE], y, ws)
                        meet_acceleration(system.plant, etdrk4.flow, before_jump, y, ws)
                if code == 0 and flows and (j == 0 or last):
                    note_beginning(system.plant, etdrk4.flow, last, y, ws)
            if j == 0:
                if code == 0 and row >= 0:
                    known = flows and np.isfinite(true_rate[0])
                    write_sample(system, t, y, true_rate if known else ws.eta_dot, ws, rows[row])
                    if done > 0 and not largest_deflection(system.plant, y) < deflection_limit:
                        code = BENT
                if code != 0 and done > 0:
                    copy(good, y)
                    return done - 1, code
                row += 1
                if row == len(rows):
                    return done, code
                if code == 0:
                    wanted = wanted_level(system, watch, y, ws)
                    if wanted != level:
                        return done, OTHER_STEP + wanted
                copy(y, good)
            if ws.interrupt[0] != 0:
                return done, INTERRUPTED
            stepped = True
        if code == 0:
            code = take_stage(system, etdrk4, generalized_alpha, rk4, stage, dt, y, ws)
        stage += 1
        if code == 0 and stage < stage_count(generalized_alpha):
            continue
        stage = np.int64(0)
        if code == 0 and diverged(system, y):
            code = DIVERGED
        j += 1
        number = (tick + done) * step_count + j
        if j == step_count:
            done, j = done + 1, 0
        t = origin + (tick + done) * tick_period + j * dt
        acts = system.control.sampled and number % sampling.steps == 0
        if code == 0 and acts:
            code = act_at_instant(system, sampling, number // sampling.steps, t, y, ws)
        if generalized_alpha is not None:
            path = system.trajectory
            jumps = not system.control.sampled and is_discontinuous(path, t)
            if code == 0 and jumps:
                code = find_state(system, t - path.inside, y, ws)
            if code == 0 and (acts or jumps):
                follow_jump(system, t + path.inside, y, ws)
        if code != 0:
            copy(good, y)
            return done - (j == 0), code
