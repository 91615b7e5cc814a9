"""Generalized-α (Chung & Hulbert, J. Appl. Mech. 60 (1993) 371-375), order 2, with damping of the highest modes.

The beam's stiffness and damping are implicit through a block inverse that is computed once; the rest converges in
`CORRECTIONS` fixed-point rounds. Pose and beam are integrated as (x, η) with velocities; the algorithmic accelerations,
which belong to a slightly shifted instant, are carried at the end of the state; where inputs jump, they jump as well. Quantities
with a first-order equation (controller memory, energies) are advanced with the rates at the step's beginning and at its α-point,
weighted to order 2.
"""

import numpy as np

from flexlab.compiled import inlined
from flexlab.numerics.linear_algebra import inverse as inverse_of
from flexlab.numerics.linear_algebra import solve_symmetric
from flexlab.physics.dynamics import acceleration, block_product, set_momenta
from flexlab.physics.plant import ETA, WORK, G, H, X, joints_start, memory_start
from flexlab.sim.closed_loop import find_inputs
from flexlab.sim.integrators.scheme import STATE

RHO = 0.8
"""Spectral radius at infinite frequency: unresolved modes lose a fifth of their amplitude per step."""
ALPHA_M = (2 * RHO - 1) / (RHO + 1)
ALPHA_F = RHO / (RHO + 1)
GAMMA = 0.5 - ALPHA_M + ALPHA_F
BETA = 0.25 * (1 - ALPHA_M + ALPHA_F) * (1 - ALPHA_M + ALPHA_F)
CORRECTIONS = 3
"""Rounds per step. Each contracts the controller's terms by about Δt times its rate, so that three keep the order."""


def effective_inverse(omega: np.ndarray, damping: np.ndarray, block_start: np.ndarray, dt: float) -> np.ndarray:
    """Inverse of (1 - α_m) + (1 - α_f)(γ dt D + β dt² Ω²), block diagonal, (n_m, n_m)."""
    inverse = np.zeros_like(damping)
    for low, high in zip(block_start[:-1], block_start[1:], strict=True):
        own = slice(low, high)
        stiffness = np.diag(omega[own] * omega[own])
        effective = (1 - ALPHA_F) * (GAMMA * dt * damping[own, own] + BETA * (dt * dt) * stiffness)
        inverse[own, own] = inverse_of(effective + (1 - ALPHA_M) * np.eye(high - low))
    return inverse


@inlined
def correct(system, constants, x_ddot, middle, new, ws):
    """One round: move the new accelerations (x first, then η) so that the α-point's balance M (a_true - a_m) vanishes."""
    plant, n = system.plant, system.plant.modal.shape[1]
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    error, solved = ws.stage[7, 0:n], ws.stage[8, 0:n]
    dx = ws.momentum
    for a in range(3):
        dx[a] = x_ddot[a] - middle[a]
    lateral, turn = c * x_ddot[1] - s * x_ddot[0], x_ddot[2]
    d_lateral, d_turn = c * dx[1] - s * dx[0], dx[2]
    h_error = g_error = h_solved = g_solved = 0.0
    hh = hg = gg = 0.0
    for k in range(n):
        h, g = plant.modal[H, k], plant.modal[G, k]
        # Difference of η̈, then A12 of it, then the balance of mode k.
        difference = -ws.restoring[k] - h * lateral - g * turn - middle[3 + k]
        h_error += h * difference
        g_error += g * difference
        error[k] = difference + h * d_lateral + g * d_turn
        hh += constants.coupling[0, k] * h
        hg += constants.coupling[0, k] * g
        gg += constants.coupling[1, k] * g
        h_solved += constants.coupling[0, k] * error[k]
        g_solved += constants.coupling[1, k] * error[k]
    block_product(plant.block_start, constants.inverse, error, solved)
    # (M̄ + A11) dx = S dx + A12 A21 dx; then the beam is eliminated from the balance and from the matrix.
    weight = 1 - ALPHA_M
    lateral_force = h_error + plant.kappa[0] * d_lateral + plant.kappa[1] * d_turn - weight * h_solved
    turn_force = g_error + plant.kappa[1] * d_lateral + plant.kappa[2] * d_turn - weight * g_solved
    r0 = ws.S[0, 0] * dx[0] + ws.S[0, 1] * dx[1] + ws.S[0, 2] * dx[2] - s * lateral_force
    r1 = ws.S[1, 0] * dx[0] + ws.S[1, 1] * dx[1] + ws.S[1, 2] * dx[2] + c * lateral_force
    r2 = ws.S[2, 0] * dx[0] + ws.S[2, 1] * dx[1] + ws.S[2, 2] * dx[2] + turn_force
    dx[0], dx[1], dx[2] = r0, r1, r2
    hh, hg, gg = plant.kappa[0] - weight * hh, plant.kappa[1] - weight * hg, plant.kappa[2] - weight * gg
    S = ws.S
    S[0, 0], S[1, 0], S[1, 1] = S[0, 0] + s * s * hh, S[1, 0] - s * c * hh, S[1, 1] + c * c * hh
    S[2, 0], S[2, 1], S[2, 2] = S[2, 0] - s * hg, S[2, 1] + c * hg, S[2, 2] + gg
    solve_symmetric(S, dx)
    lateral, turn = c * dx[1] - s * dx[0], dx[2]
    for a in range(3):
        new[a] += dx[a] / weight
    for k in range(n):
        new[3 + k] += solved[k] - constants.coupling[0, k] * lateral - constants.coupling[1, k] * turn


@inlined
def generalized_alpha_stage(system, constants, stage, dt, y, ws):
    """`take_stage` of generalized-α: a prediction, then `CORRECTIONS` rounds with rates at the α-point; returns a fault code."""
    plant, n = system.plant, system.plant.modal.shape[1]
    first_rate, late_rate, velocity, middle, new = ws.stage[0], ws.stage[1], ws.stage[2], ws.stage[3], ws.stage[4]
    z, x_ddot = ws.stage[STATE], ws.stage[6, 0:3]
    memory, memory_end = joints_start(plant), memory_start(plant) + system.control.memory_size
    old = y[ETA + 2 * n : memory]
    acceleration(plant, y if stage == 0 else z, ws.eta_dot, ws.w_bar[0], ws.beam_rate[0], ws.u, ws, x_ddot)
    if stage == 0:
        _begin_step(plant, x_ddot, velocity, old, new, ws)
    else:
        correct(system, constants, x_ddot, middle, new, ws)
    if stage < CORRECTIONS:
        for i in range(memory, memory_end):
            z[i] = y[i] + (1 - ALPHA_F) * dt * first_rate[i]
        return _alpha_point(plant, dt, y, velocity, old, new, first_rate, middle, z, ws)
    weight = 0.5 / (1 - ALPHA_F)
    for i in range(WORK, ETA):
        y[i] += dt * ((1 - weight) * first_rate[i] + weight * late_rate[i])
    for i in range(memory, memory_end):
        y[i] += dt * ((1 - weight) * first_rate[i] + weight * late_rate[i])
    for i in range(3 + n):
        at = X + i if i < 3 else ETA + i - 3
        y[at] += dt * velocity[i] + dt * dt * ((0.5 - BETA) * old[i] + BETA * new[i])
        velocity[i] += dt * ((1 - GAMMA) * old[i] + GAMMA * new[i])
        old[i] = new[i]
    return set_momenta(plant, y, velocity[0:3], velocity[3 : 3 + n], ws)


@inlined
def _begin_step(plant, x_ddot, velocity, old, new, ws):
    """Note the velocities (x, η) and predict the new accelerations by the old ones; a fresh state has the true ones."""
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    lateral = c * x_ddot[1] - s * x_ddot[0]
    fresh = not np.isfinite(old[0])
    for i in range(len(old)):
        velocity[i] = ws.velocity[i] if i < 3 else ws.eta_dot[i - 3]
        if fresh:
            if i < 3:
                old[i] = x_ddot[i]
            else:
                k = i - 3
                old[i] = -ws.restoring[k] - plant.modal[H, k] * lateral - plant.modal[G, k] * x_ddot[2]
        new[i] = old[i]


@inlined
def _alpha_point(plant, dt, y, velocity, old, new, first_rate, middle, z, ws):
    """Fill the state z (with momenta) and the accelerations `middle` of the α-point; returns a fault code."""
    n = plant.modal.shape[1]
    now = 1 - ALPHA_F
    rate = ws.stage[9]
    for i in range(3 + n):
        at = X + i if i < 3 else ETA + i - 3
        z[at] = y[at] + now * (dt * velocity[i] + dt * dt * ((0.5 - BETA) * old[i] + BETA * new[i]))
        rate[i] = velocity[i] + now * dt * ((1 - GAMMA) * old[i] + GAMMA * new[i])
        middle[i] = (1 - ALPHA_M) * new[i] + ALPHA_M * old[i]
    for i in range(WORK, ETA):
        z[i] = y[i] + now * dt * first_rate[i]
    return set_momenta(plant, z, rate[0:3], rate[3 : 3 + n], ws)


@inlined
def follow_jump(system, t, y, ws):
    """Add to the accelerations in y what a jump of the inputs adds, after `find_state` of y with the inputs before it.

    t: an instant after the jump, s. Accelerations from before it would leave an error of first order in the velocities.
    """
    plant, n, jump = system.plant, system.plant.modal.shape[1], ws.momentum
    for a in range(3):
        jump[a] = 0.0
        for i in range(len(plant.arms)):
            jump[a] -= ws.u[i, a]
    find_inputs(system, t, y, ws)
    for a in range(3):
        for i in range(len(plant.arms)):
            jump[a] += ws.u[i, a]
    solve_symmetric(ws.S, jump)
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    noted, lateral = y[ETA + 2 * n : ETA + 3 * n + 3], c * jump[1] - s * jump[0]
    for a in range(3):
        noted[a] += jump[a]
    for k in range(n):
        noted[3 + k] -= plant.modal[H, k] * lateral + plant.modal[G, k] * jump[2]
