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
    state = y
    for stage in range(4):
        reach = 0.0 if stage == 0 else (dt if stage == 3 else dt / 2)
        code = rates(system, t + reach, state, ws, k, True)
        if code != 0:
            return code
        onward = dt if stage == 2 else dt / 2
        weight = 2.0 if stage == 1 or stage == 2 else 1.0
        for i in range(end):
            total[i] = weight * k[i] + (total[i] if stage > 0 else 0.0)
            z[i] = y[i] + onward * k[i]
        state = z
    for i in range(end):
        y[i] += dt / 6 * total[i]
    return 0
