"""The engine's inner loop: whole ticks of equal steps, one sample row per tick, no allocation, no global lock."""

from flexlab.compiled import compiled, inlined
from flexlab.physics.arm import NOT_A_NUMBER
from flexlab.physics.plant import DISSIPATED
from flexlab.sim.integrators.step import integrate
from flexlab.sim.observe import MIDSPAN, observe
from flexlab.sim.sampled_control import control_instant

DIVERGED, BENT = NOT_A_NUMBER, 4
"""Fault codes of the loop besides those of `physics.arm`: not a number or runaway; deflection as large as the beam."""

RUNAWAY = 1e9
"""A state beyond this (m, rad, kg·m/s, …) has diverged, whatever it is."""


@inlined
def diverged(y):
    """Whether any of the pose, momentum, memory and energy states is not finite or out of all bounds."""
    for i in range(DISSIPATED + 1):
        if not abs(y[i]) < RUNAWAY:
            return True
    return False


@compiled
def advance(system, sampling, scheme, deflection_limit, tick, tick_period, step_count, y, good, ws, rows):
    """Advance y by len(rows) ticks of `step_count` steps from tick number `tick`, filling rows (ticks, row_length).

    Control instants lie on steps. Returns the ticks done and a fault code; on a fault y is set back to the last good tick
    (`good`, like y, is scratch).
    """
    dt = tick_period / step_count
    for done in range(len(rows)):
        for i in range(len(y)):
            good[i] = y[i]
        start = (tick + done) * tick_period
        code = 0
        for j in range(step_count):
            code = integrate(system, scheme, start + j * dt, dt, y, ws)
            if code == 0 and diverged(y):
                code = DIVERGED
            if code != 0:
                break
            number = (tick + done) * step_count + j + 1
            if system.control.sampled and number % sampling.steps == 0:
                t = (tick + done + 1) * tick_period if j == step_count - 1 else start + (j + 1) * dt
                code = control_instant(system, sampling, number // sampling.steps, t, y, ws)
                if code != 0:
                    break
        if code == 0:
            code = observe(system, (tick + done + 1) * tick_period, y, ws, rows[done])
        if code == 0 and not abs(rows[done, MIDSPAN]) < deflection_limit:
            code = BENT
        if code != 0:
            for i in range(len(y)):
                y[i] = good[i]
            return done, code
    return len(rows), 0
