"""One stage of a step of the chosen integrator: from the rates at its state to the next stage's state, or to the end of the step.

The classical Runge-Kutta method of order 4 is here as well, for soft or coarse beams with Δt ω_max below its stability limit.
"""

from flexlab.compiled import inlined
from flexlab.physics.plant import memory_start
from flexlab.sim.integrators import generalized_alpha as alpha
from flexlab.sim.integrators.etdrk4 import etdrk4_stage
from flexlab.sim.integrators.generalized_alpha import generalized_alpha_stage
from flexlab.sim.integrators.scheme import STATE

STABILITY_LIMIT = 2.7
"""Δt ω_max up to which rk4 is stable on the imaginary axis (2√2), less a margin for damping and control."""


@inlined
def rk4_stage(system, stage, dt, y, ws):
    """`take_stage` of rk4; the weighted sum of the rates accumulates in ws.stage[0]."""
    end = memory_start(system.plant) + system.control.memory_size
    total, k, z = ws.stage[0], ws.stage[1], ws.stage[STATE]
    if stage == 0:
        for i in range(end):
            z[i] = y[i] + dt / 2 * total[i]
        return
    onward, weight = (dt, 2.0) if stage == 2 else (dt / 2, 2.0 if stage == 1 else 1.0)
    for i in range(end):
        total[i] += weight * k[i]
        z[i] = y[i] + onward * k[i]
    if stage == 3:
        for i in range(end):
            y[i] += dt / 6 * total[i]


CLASSICAL_STAGES, ALPHA_STAGES = 4, alpha.CORRECTIONS + 1
ALPHA_PART = 1 - alpha.ALPHA_F


@inlined
def stage_count(generalized_alpha):
    """Evaluations of the rates per step."""
    return CLASSICAL_STAGES if generalized_alpha is None else ALPHA_STAGES


@inlined
def stage_instant(generalized_alpha, stage, t, dt, inside):
    """The instant of a stage of the step from t, s; the ends of the step are moved `inside` s into it."""
    if stage == 0:
        return t + inside
    if generalized_alpha is not None:
        return t + ALPHA_PART * dt
    return t + (dt - inside if stage == 3 else dt / 2)


@inlined
def rates_row(etdrk4, stage):
    """Row of `Workspace.stage` for the rates of a stage."""
    return min(stage, 1) if etdrk4 is None else stage


@inlined
def take_stage(system, etdrk4, generalized_alpha, rk4, stage, dt, y, ws):
    """Turn the rates of a stage, in their row, into the state of the next one, or into y after the last; returns a fault code."""
    code = 0
    if etdrk4 is not None:
        etdrk4_stage(system, etdrk4, stage, dt, y, ws)
    if generalized_alpha is not None:
        code = generalized_alpha_stage(system, generalized_alpha, stage, dt, y, ws)
    if rk4 is not None:
        rk4_stage(system, stage, dt, y, ws)
    return code
