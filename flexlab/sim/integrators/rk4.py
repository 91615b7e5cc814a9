"""Classical Runge-Kutta of order 4: for soft or coarse beams, where Δt ω_max stays under its stability limit."""

from flexlab.compiled import compiled
from flexlab.physics.plant import ETA
from flexlab.sim.closed_loop import rates

STABILITY_LIMIT = 2.7
"""Δt ω_max up to which the method is stable on the imaginary axis (2√2), less a margin for damping and control."""


@compiled
def rk4_step(system, t, dt, y, ws):
    """Advance y by dt in place; returns a fault code."""
    end = ETA + 2 * system.plant.modal.shape[1]
    total, k, z = ws.stage[0], ws.stage[1], ws.stage[2]
    code = rates(system, t, y, ws, total, True)
    for i in range(end):
        k[i] = total[i]
    for stage in range(1, 4):
        reach = dt if stage == 3 else dt / 2
        for i in range(end):
            z[i] = y[i] + reach * k[i]
        code = max(code, rates(system, t + reach, z, ws, k, True))
        if code != 0:
            return code
        weight = 1.0 if stage == 3 else 2.0
        for i in range(end):
            total[i] += weight * k[i]
    for i in range(end):
        y[i] += dt / 6 * total[i]
    return code
