"""The beam's exact motion over a step with grips whose acceleration is linear in time: its true rates and its loss.

A Runge-Kutta sum gives η̇ = π - h v2 - g ω to the order of the step. Damping multiplies its error by D, up to 10⁹ 1/s, so that the
force Dη̇ and the power η̇ᵀDη̇ made from it are meaningless for modes that are damped faster than the step. In the frame of the
virtual link the beam is linear, with b = (v̇2 + ω v1 + gravity cos θ, ω̇) and C = (h, g):

    η̈ + Dη̇ + Ω²η = f - C b(s),   b = b0 + b1 s,   f: centrifugal force, constant over the step, and -K_G η, linear in it.

b has the mean that the velocities at the step's ends give, and ends at the acceleration of the pose there, with modes that are
damped faster than the step moving with the link. (The velocity at a stage in the middle has not the order that b1 needs.) With
η* = Ω⁻²(f - C b) and E(s) = ½|η̇|² + ½(η - η*)ᵀΩ²(η - η*) the loss of that motion is

    ∫η̇ᵀDη̇ ds = E(0) - E(h) + (f1 - C b1)ᵀΩ⁻²(Δη̇ + DΔη),      f1: slope of f,

whatever the stiffness of a mode: no mode is too fast for it. Each step begins with the η̇ at which this motion ended in the step
before, for modes that are damped fast and not coupled: the error of the Runge-Kutta sum would decay in each step, and its energy
would count as loss. It is not the defect of the energy balance, as it uses nothing of
the new state that the integrator finds. Only while a hand holds the beam, whose force is not among these, the loss is that
defect (`sim.advance`).

Where a sample is taken, η̇ is that of another b: the line through the velocities at the step's beginning, middle and end, and
then the parabola with the same mean that begins and ends at the accelerations from the rates at these instants, as η̇ of a fast
damped mode follows the slope of b. If the inputs jump at that instant, b ends at the acceleration before the jump. If its
beginning is unknown, as after a start, the parabola deviates from the line by the same at both ends.
"""

import numpy as np

from flexlab.compiled import disjoint, inlined
from flexlab.numerics.linear_algebra import product, solve_symmetric
from flexlab.physics.axial_load import END, NOW, SCRATCH, followed_loads, predict_acceleration
from flexlab.physics.axial_load import START as BEFORE
from flexlab.physics.dynamics import acceleration, block_product
from flexlab.physics.hand import beam_is_held
from flexlab.physics.plant import DISSIPATED, ETA, OMEGA2, G, H, has_axial_load

ROWS = 25
"""Rows of `Etdrk4.flow`. The first: η and η̇ at the step's end for b = 1, then for b = s, lateral and angular each."""
DAMPED, BEGUN, BEGUN_FORCE, MET, MET_FORCE, FAST, SLOW, KEPT = 8, 10, 12, 14, 16, 18, 19, 23
"""Further rows, two each: DΩ⁻²h and DΩ⁻²g; for fast modes only, η̇ at the step's end for the parabola of mean 0 that begins at
1 and ends at 0, and D times that; the same for the one that begins at 0 and ends at 1. Then 1 for a fast mode, else 0; four
rows of `followed_loads` for modes that are not fast; and η and η̇ at the step's end for η̇ = 1 at its beginning, of modes that
are not coupled to others and lose more than `KEPT_DAMPING`, else 0."""
FAST_DAMPING = 3.0
"""Step times D of a mode from which on the flow gives a better η̇ than the integrator, although of lower order."""
KEPT_DAMPING = 0.3
"""Step times D of a mode from which on the η̇ with which the flow ended the step before serves its loss."""
TICKS = 2
"""Index behind η and π of the number of ticks since a start, a tap or a change set the state; NaN before the first."""
SAVED, MISSED = 9, 10
"""Row of `Workspace.stage` that keeps η, η̇ and f of a step's beginning; its last entries keep the grips' motion. And the row that
keeps by how much that η̇ exceeds the integrator's."""
START, MIDDLE = -6, -3
"""Index in that row of v2, ω and the part of b that is not a derivative, ω v1 + gravity cos θ, at these instants."""
BEGINNING, LINE = -8, -10
"""Index in that row of two values for the beginning of a tick's last step: b, NaN if unknown, and what the line gives for it."""


def flow_rows(
    omega: np.ndarray, damping: np.ndarray, loads: np.ndarray, phi: tuple[np.ndarray, ...], dt: float
) -> np.ndarray:
    """Columns of `Etdrk4.flow` (25, k) for one block with ω (k,), D (k, k), loads (2, k) and φ0 to φ3(hL) in (ωη, η̇)."""
    k = len(omega)
    rows = np.zeros((ROWS, k))
    phi0, phi1, phi2, phi3 = phi
    rows[FAST] = dt * damping.diagonal() > FAST_DAMPING
    if k == 1 and dt * damping[0, 0] > KEPT_DAMPING:
        rows[KEPT:] = phi0[:, 1:] / np.array([omega, [1.0]])
    rows[SLOW:KEPT] = followed_loads(rows[FAST] == 0, damping, loads.T)
    straight, curved = dt * (2 * phi2 - phi1), dt * (12 * phi3 - 6 * phi2 + phi1)
    across, both = -loads.T, loads.T / (omega * omega)[:, None]
    for row, function in ((BEGUN, curved - straight), (MET, curved + straight)):
        answer = rows[FAST][:, None] * product(function[k:, k:], across) / 2
        rows[row : row + 2], rows[row + 2 : row + 4] = answer.T, product(damping, answer).T
    for power, function in enumerate((dt * phi1, dt * dt * phi2)):
        answer = product(function[:, k:], across)
        rows[2 * power : 8 : 4], rows[2 * power + 1 : 8 : 4] = answer[:k].T / omega, answer[k:].T
    rows[DAMPED : DAMPED + 2] = product(damping, both).T
    return rows


@inlined
def note_grips(plant, ws, at):
    """Keep the grips' lateral and angular velocity and ω v1 + gravity cos θ."""
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    v, kept = ws.velocity, ws.stage[SAVED]
    kept[at] = c * v[1] - s * v[0]
    kept[at + 1] = v[2]
    kept[at + 2] = v[2] * (c * v[0] + s * v[1]) + plant.gravity * c


@disjoint
def _begin_rates(flow, true_rate, rate, missed):
    """Replace η̇ (n,) by `true_rate` (n,) where the flow keeps it, and fill by how much that exceeds it; NaN if it is unknown."""
    for k in range(len(rate)):
        missed[k] = 0.0
        if flow[KEPT, k] != 0 and np.isfinite(true_rate[k]):
            missed[k] = true_rate[k] - rate[k]
            rate[k] = true_rate[k]


@inlined
def begin_flow(plant, flow, y, ws):
    """Keep what the flow needs of a step's beginning, after `find_state`."""
    n = plant.modal.shape[1]
    kept, w = ws.stage[SAVED], ws.velocity[2]
    note_grips(plant, ws, START)
    lift = kept[START + 2]
    for k in range(n):
        kept[k], kept[n + k] = y[ETA + k], ws.eta_dot[k]
        kept[2 * n + k] = w * w * y[ETA + k] - plant.modal[H, k] * lift
    _note_axial_load(plant.axial, kept[2 * n : 3 * n], ws)
    if flow.shape[1] > 0:
        _begin_rates(flow, y[ETA + 2 * n + 3 : ETA + 3 * n + 3], kept[n : 2 * n], ws.stage[MISSED, :n])


@inlined
def _note_axial_load(axial, loads, ws):
    """Note the axial load's force of a step's beginning, and subtract it from the loads s (n,)."""
    if axial is None:
        return
    if axial.shape[1] > 0:
        for k in range(len(loads)):
            ws.axial_force[BEFORE, k] = ws.axial_force[NOW, k]
            loads[k] -= ws.axial_force[NOW, k]


@inlined
def _find_axial_slopes(axial, per_step, ws, slopes):
    """Fill the slopes (n,) of the axial load's force K_G η over the step that ends; zero without such a load."""
    axial_load = has_axial_load(axial)
    for k in range(len(slopes)):
        slopes[k] = (ws.axial_force[END, k] - ws.axial_force[BEFORE, k]) * per_step if axial_load else 0.0


@inlined
def _axial_loss(axial, plant, slopes, bent, ws):
    """What the axial load's slopes (n,) add to the loss of modes that bend by `bent` (n,)."""
    loss = 0.0
    if has_axial_load(axial):
        block_product(plant.block_start, plant.damping, bent, ws.damping_force)
        for k in range(len(slopes)):
            loss -= slopes[k] / plant.modal[OMEGA2, k] * ws.damping_force[k]
    return loss


@disjoint
def _mode_losses(modal, flow, dt, b, b_slope, free, kept, missed, slopes, bent, true_rate, lost):
    """Fill the loss of each mode, and by how much it bends, (n,), for b (lateral, angular) at the step's beginning and its slope.

    free: (η, π) at the step's end if the grips had kept their velocity; kept, missed: as `SAVED` and `MISSED`; slopes (n,): of
    the axial load's force; true_rate (n,) gets η̇ of the step's end where the flow keeps it.
    """
    n, (lateral, turn), (lateral_slope, turn_slope) = len(lost), b, b_slope
    eta, rate, force, free_eta, free_pi = kept[:n], kept[n : 2 * n], kept[2 * n : 3 * n], free[:n], free[n : 2 * n]
    first, first_turn = kept[START], kept[START + 1]
    for k in range(n):
        h, g, stiffness = modal[H, k], modal[G, k], modal[OMEGA2, k]
        change = free_eta[k] + lateral * flow[0, k] + lateral_slope * flow[2, k] + turn * flow[4, k]
        change += turn_slope * flow[6, k] + missed[k] * flow[KEPT, k] - eta[k]
        gain = free_pi[k] - h * first - g * first_turn + lateral * flow[1, k] + lateral_slope * flow[3, k]
        gain += turn * flow[5, k] + turn_slope * flow[7, k] + missed[k] * flow[KEPT + 1, k] - rate[k]
        slope = (h * lateral_slope + g * turn_slope + slopes[k]) / stiffness
        u_0, u_1 = stiffness * eta[k] - force[k] + h * lateral + g * turn, change + dt * slope
        lost[k] = -gain * (rate[k] + gain / 2 + slope) - u_1 * (u_0 + stiffness * u_1 / 2)
        lost[k] -= (lateral_slope * flow[DAMPED, k] + turn_slope * flow[DAMPED + 1, k]) * change
        bent[k] = change
        if flow[KEPT, k] != 0:
            true_rate[k] = rate[k] + gain


@inlined
def mean_b(plant, dt, ws):
    """Mean b of the step that ends, less ω v1 + gravity cos θ at its beginning, lateral and angular; and that term at its end."""
    c, s, v, kept = ws.arm.trig[0], ws.arm.trig[1], ws.velocity, ws.stage[SAVED]
    v2, lift, lift_0 = c * v[1] - s * v[0], v[2] * (c * v[0] + s * v[1]) + plant.gravity * c, kept[START + 2]
    lateral = (v2 - kept[START]) / dt + (lift + 4 * kept[MIDDLE + 2] - 5 * lift_0) / 6
    return lateral, (v[2] - kept[START + 1]) / dt, lift


@inlined
def end_flow(plant, flow, dt, free, u, y, ws):
    """Add the loss of the step that ends in y, after `find_state` of y.

    `free`: (η, π) at the step's end if the grips had kept their velocity; u (arms, 3): inputs up to this instant.
    """
    if beam_is_held(plant):
        return
    n, kept = plant.modal.shape[1], ws.stage[SAVED]
    c, s, x_ddot, per_step = ws.arm.trig[0], ws.arm.trig[1], ws.axial_acceleration, 1 / dt
    lateral, turn, _ = mean_b(plant, dt, ws)
    predict_acceleration(plant, flow[SLOW:], plant.axial, u, y, ws)
    met = c * x_ddot[1] - s * x_ddot[0] + plant.gravity * c - kept[START + 2]
    lateral_slope, turn_slope = 2 * (met - lateral) * per_step, 2 * (x_ddot[2] - turn) * per_step
    start = 2 * lateral - met, 2 * turn - x_ddot[2]
    slopes, bent, lost = ws.axial_force[BEFORE], ws.axial_force[SCRATCH], ws.stage[6, :n]
    missed, true_rate = ws.stage[MISSED, :n], y[ETA + 2 * n + 3 : ETA + 3 * n + 3]
    _find_axial_slopes(plant.axial, per_step, ws, slopes)
    b_slope = (lateral_slope, turn_slope)
    _mode_losses(plant.modal, flow, dt, start, b_slope, free[ETA:], kept, missed, slopes, bent, true_rate, lost)
    loss = _axial_loss(plant.axial, plant, slopes, bent, ws)
    for k in range(n):
        loss += lost[k]
    y[DISSIPATED] += loss


@inlined
def note_rates(plant, flow, dt, free, y, ws):
    """Note η̇ and b of the step's end behind the state, as `end_flow` for a line b through the velocity in its middle."""
    n = plant.modal.shape[1]
    kept, rate, b = ws.stage[SAVED], y[ETA + 2 * n + 3 : ETA + 3 * n + 3], y[ETA + 2 * n : ETA + 2 * n + 2]
    if beam_is_held(plant):
        for k in range(n):
            rate[k] = np.nan
        return
    c, s, v, first = ws.arm.trig[0], ws.arm.trig[1], ws.velocity, kept[START]
    lateral, turn, lift = mean_b(plant, dt, ws)
    v2 = c * v[1] - s * v[0]
    lateral_slope = 4 * (first - 2 * kept[MIDDLE] + v2) / (dt * dt) + (lift - kept[START + 2]) / dt
    turn_slope = 4 * (kept[START + 1] - 2 * kept[MIDDLE + 1] + v[2]) / (dt * dt)
    b[0], b[1] = lateral + dt / 2 * lateral_slope + kept[START + 2], turn + dt / 2 * turn_slope
    lateral, turn = lateral - dt / 2 * lateral_slope, turn - dt / 2 * turn_slope
    kept[LINE], kept[LINE + 1] = lateral + kept[START + 2], turn
    for k in range(n):
        rate[k] = ws.eta_dot[k]
        if flow[FAST, k] != 0:
            rate[k] = free[ETA + n + k] - plant.modal[H, k] * first - plant.modal[G, k] * kept[START + 1]
            rate[k] += lateral * flow[1, k] + lateral_slope * flow[3, k] + turn * flow[5, k] + turn_slope * flow[7, k]


@inlined
def has_fast_modes(flow):
    """Whether any mode is damped faster than the step."""
    for k in range(flow.shape[1] - 1, -1, -1):  # Mostly the last are.
        if flow[FAST, k] != 0:
            return True
    return False


@inlined
def present_b(plant, u, y, ws, b):
    """Fill b (2,) from the acceleration for the noted η̇ and inputs u (arms, 3), after `find_state` of y."""
    n = plant.modal.shape[1]
    x_ddot, c, s = ws.stage[8, 0:3], ws.arm.trig[0], ws.arm.trig[1]
    acceleration(plant, y, y[ETA + 2 * n + 3 : ETA + 3 * n + 3], ws.w_bar[0], ws.beam_rate[0], u, ws, x_ddot)
    b[0], b[1] = c * x_ddot[1] - s * x_ddot[0] + plant.gravity * c, x_ddot[2]


@inlined
def note_beginning(plant, flow, last, y, ws):
    """Keep b of the beginning of a tick's `last` step if the modes' true rates are known; NaN otherwise."""
    n, b = plant.modal.shape[1], ws.stage[SAVED, BEGINNING : BEGINNING + 2]
    b[0] = np.nan
    if last and has_fast_modes(flow) and np.isfinite(y[ETA + 2 * n + 3]):
        present_b(plant, ws.u, y, ws, b)


@inlined
def meet_acceleration(plant, flow, u, y, ws):
    """Correct the noted η̇ so that b ends at the present acceleration, after `note_rates`; u (arms, 3): inputs up to this instant.

    Fast modes have followed these inputs, and not those that a controller asks for from this instant on.
    """
    n = plant.modal.shape[1]
    b, rate, found, across = (
        y[ETA + 2 * n : ETA + 2 * n + 2],
        y[ETA + 2 * n + 3 : ETA + 3 * n + 3],
        ws.stage[8, 6:8],
        ws.stage[8, 3:6],
    )
    if not has_fast_modes(flow) or not np.isfinite(rate[0]):
        return
    begun, unknown = ws.stage[SAVED, BEGINNING : BEGINNING + 2], 1.0
    if np.isfinite(begun[0]):
        early, early_turn, unknown = begun[0] - ws.stage[SAVED, LINE], begun[1] - ws.stage[SAVED, LINE + 1], 0.0
        for k in range(n):
            rate[k] += early * flow[BEGUN, k] + early_turn * flow[BEGUN + 1, k]
    c, s = ws.arm.trig[0], ws.arm.trig[1]
    present_b(plant, u, y, ws, found)
    missed, missed_turn = found[0] - b[0], found[1] - b[1]
    hh = hg = gh = gg = 0.0
    for k in range(n):
        h, g = plant.modal[H, k], plant.modal[G, k]
        on_h = flow[MET_FORCE, k] + unknown * flow[BEGUN_FORCE, k]
        on_g = flow[MET_FORCE + 1, k] + unknown * flow[BEGUN_FORCE + 1, k]
        hh, hg, gh, gg = hh + h * on_h, hg + h * on_g, gh + g * on_h, gg + g * on_g
    # Change of the acceleration itself by one unit at the end, through the force Dη̇ on the grips: S⁻¹ (h, g)ᵀ(Dη̇).
    across[0], across[1], across[2] = -s, c, 0.0
    solve_symmetric(ws.S, across)
    W_hh, W_gh = c * across[1] - s * across[0], across[2]
    across[0], across[1], across[2] = 0.0, 0.0, 1.0
    solve_symmetric(ws.S, across)
    W_gg = across[2]
    m00, m01 = 1 - W_hh * hh - W_gh * gh, -W_hh * hg - W_gh * gg
    m10, m11 = -W_gh * hh - W_gg * gh, 1 - W_gh * hg - W_gg * gg
    determinant = m00 * m11 - m01 * m10
    late, late_turn = (
        (m11 * missed - m01 * missed_turn) / determinant,
        (m00 * missed_turn - m10 * missed) / determinant,
    )
    for k in range(n):
        rate[k] += late * (flow[MET, k] + unknown * flow[BEGUN, k])
        rate[k] += late_turn * (flow[MET + 1, k] + unknown * flow[BEGUN + 1, k])
