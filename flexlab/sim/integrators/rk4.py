"""Classical Runge-Kutta of order 4: for soft or coarse beams, where Δt ω_max stays under its stability limit."""

from flexlab.compiled import inlined
from flexlab.physics.plant import memory_start
from flexlab.sim.integrators.scheme import STATE

STABILITY_LIMIT = 2.7
"""Δt ω_max up to which the method is stable on the imaginary axis (2√2), less a margin for damping and control."""


@inlined
def rk4_stage(system, stage, dt, y, ws):
    """`take_stage` of this method: the rates' weighted sum grows in ws.stage[0]."""
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
