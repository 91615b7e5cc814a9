"""The engine's inner loop: whole ticks of equal steps, one sample row per tick, no allocation, no global lock."""

import numpy as np

from flexlab.compiled import compiled, inlined
from flexlab.physics.arm import NOT_A_NUMBER
from flexlab.physics.plant import BEND, DISSIPATED, ETA
from flexlab.sim.closed_loop import law_places, rates
from flexlab.sim.integrators.beam_flow import TICKS, end_flow, meet_acceleration
from flexlab.sim.integrators.etdrk4 import FREE
from flexlab.sim.integrators.scheme import ETDRK4
from flexlab.sim.integrators.step import integrate
from flexlab.sim.sampled_control import control_instant
from flexlab.sim.signals import write_sample
from flexlab.sim.step_levels import wanted_level

DIVERGED, BENT = NOT_A_NUMBER, 4
"""Fault codes of the loop besides those of `physics.arm`: not a number or runaway; deflection as large as the beam."""

INTERRUPTED = 5
"""Outcome of a loop that was asked to return early, by `Workspace.interrupt`, somewhere within a tick: no fault."""

OTHER_STEP = 100
"""Code of no fault: the next tick wants the step of level code - OTHER_STEP."""

RUNAWAY = 1e9
"""A state beyond this (m, rad, kg·m/s, …) has diverged, whatever it is."""


@inlined
def diverged(system, y):
    """Whether any of the pose, momentum, energy and memory states is not finite or out of all bounds."""
    for i in range(DISSIPATED + 1):
        if not abs(y[i]) < RUNAWAY:
            return True
    start, end = law_places(system)
    for i in range(start, end):
        if not abs(y[i]) < RUNAWAY:
            return True
    return False


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
    scheme,
    watch,
    level,
    deflection_limit,
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

    With `first_is_present` the first row takes the present instant. Control instants lie on steps. Returns the ticks done
    and a fault code, or `OTHER_STEP` plus the level of step that the next tick wants where that is not `level`. On a fault y
    is set back to the last good tick (`good`, like y, is scratch).
    """
    # The rates at a tick serve its sample and the step that follows. They stand here once: whatever the block sizes, the
    # same machine code gives the same bits; and handing a whole system to a function costs more than most of them.
    dt = tick_period / step_count
    row = 0 if first_is_present else -1
    done = j = 0
    n = system.plant.modal.shape[1]
    true_rate = y[ETA + 2 * n + 3 : ETA + 3 * n + 3]
    flows, stepped = scheme.kind == ETDRK4 and scheme.flow.shape[1] > 0, False
    while True:
        start = (tick + done) * tick_period
        t = start + j * dt
        code = rates(system, t, y, ws, ws.stage[0], scheme.kind != ETDRK4)
        if code == 0 and flows and stepped:
            end_flow(system.plant, scheme.flow, dt, ws.stage[FREE], y, ws)
            if j == 0:
                since = ETA + 2 * n + TICKS
                y[since] = y[since] + 1 if y[since] >= 1 else 1.0
                meet_acceleration(system.plant, scheme.flow, y, ws)
        if j == 0:
            if code == 0 and row >= 0:
                known = flows and np.isfinite(true_rate[0])
                write_sample(system, t, y, true_rate if known else ws.eta_dot, ws, rows[row])
                if done > 0 and not largest_deflection(system.plant, y) < deflection_limit:
                    code = BENT
            if code != 0 and done > 0:
                for i in range(len(y)):
                    y[i] = good[i]
                return done - 1, code
            row += 1
            if row == len(rows):
                return done, code
            if code == 0:
                wanted = wanted_level(system, watch, y, ws)
                if wanted != level:
                    return done, OTHER_STEP + wanted
            for i in range(len(y)):
                good[i] = y[i]
        if ws.interrupt[0] != 0:
            return done, INTERRUPTED
        stepped = True
        if code == 0:
            code = integrate(system, scheme, t, dt, y, ws)
        if code == 0 and diverged(system, y):
            code = DIVERGED
        j += 1
        number = (tick + done) * step_count + j
        if j == step_count:
            done, j = done + 1, 0
        if code == 0 and system.control.sampled and number % sampling.steps == 0:
            code = control_instant(
                system, sampling, number // sampling.steps, (tick + done) * tick_period + j * dt, y, ws
            )
        if code != 0:
            for i in range(len(y)):
                y[i] = good[i]
            return done - (j == 0), code
