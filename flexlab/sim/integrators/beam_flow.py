"""The beam's exact motion over a step with grips whose acceleration is linear in time: its true rates and its loss.

A Runge-Kutta sum gives η̇ = π - h v2 - g ω to the order of the step. Damping multiplies its error by D, up to 10⁹ 1/s, so that the
force Dη̇ and the power η̇ᵀDη̇ made from it are meaningless for modes that are damped faster than the step. In the frame of the
virtual link the beam is linear, with b = (v̇2 + ω v1 + gravity cos θ, ω̇) and C = (h, g):

    η̈ + Dη̇ + Ω²η = f - C b(s),   b = b0 + b1 s,   f: centrifugal force, constant over the step, and -K_G η, linear in it.

b follows from the velocities at a step's beginning, middle and end (the first two moments of v̇2 and ω̇, so that the loss has
the order of Simpson's rule). With η* = Ω⁻²(f - C b) and E(s) = ½|η̇|² + ½(η - η*)ᵀΩ²(η - η*) the loss of that motion is

    ∫η̇ᵀDη̇ ds = E(0) - E(h) + (f1 - C b1)ᵀΩ⁻²(Δη̇ + DΔη),      f1: slope of f,

whatever the stiffness of a mode: no mode is too fast for it. It is not the defect of the energy balance, as it uses nothing of
the new state that the integrator finds. Only while a hand holds the beam, whose force is not among these, the loss is that
defect (`sim.advance`).

Where a sample is taken, b is the parabola with the same mean that begins and ends at the accelerations from the rates at these
instants: η̇ of a fast damped mode follows the slope of b, which the velocity in the middle gives to first order only. If the
inputs jump at that instant, b ends at the acceleration before the jump. If its beginning is unknown, as after a start, the
parabola deviates from the line by the same at both ends.

A few numbers determine what moves a beam of many coupled modes, so that matrix functions act on it at a fraction of their cost.
Without its linear part the beam's rate is, by `physics.plant`,

    N = (-h, Dh) v2 + (-g, Dg) ω + (0, -h) (ω v1 + gravity cos θ) + (0, s),    s = ω²η + what a hand puts on it,

so that φ(hL) N needs the responses to three fixed forces, and otherwise only the columns of modes in which s is notable: rotation
takes ω²/Ω² of a mode's stiffness. A dense product of all reads more numbers than fit into a processor's cache.
"""

import numpy as np

from flexlab.compiled import disjoint, inlined
from flexlab.numerics.linear_algebra import product, solve_symmetric
from flexlab.physics.axial_load import END, NOW, SCRATCH, STIFF_MODE
from flexlab.physics.axial_load import START as BEFORE
from flexlab.physics.dynamics import acceleration, block_product
from flexlab.physics.hand import beam_is_held
from flexlab.physics.plant import DG, DH, DISSIPATED, ETA, OMEGA2, G, H

FEWEST_COUPLED = 16
"""Smallest number of coupled modes for which this pays: with fewer, dense matrices are as fast."""
COMMON = 3
"""Fixed forces: lateral and angular velocity of the grips, and their lift ω v1 + gravity cos θ."""


def is_factored(block_start: np.ndarray) -> bool:
    """Whether a beam with these blocks of modes is moved by its responses to fixed forces."""
    return int(np.diff(block_start).max(initial=0)) >= FEWEST_COUPLED


def forced_columns(function: np.ndarray, damping: np.ndarray, loads: np.ndarray) -> np.ndarray:
    """φ (2k, 2k) of one block, in (η, π), times the fixed forces, then times a unit force on each mode, (3 + k, 2k)."""
    k = len(damping)
    moving = np.concatenate([-loads, product(loads, damping.T)], axis=1)
    common = np.concatenate([moving, [np.concatenate([np.zeros(k), -loads[0]])]])
    return np.concatenate([product(common, function.T), function[:, k:].T])


def soft_modes(omega: np.ndarray, block_start: np.ndarray) -> np.ndarray:
    """Number of modes in each block, ordered by frequency, in which rotation is notable, (blocks,).

    Above `STIFF_MODE` it takes about a billionth of the stiffness, at 10 rad/s.
    """
    blocks = zip(block_start[:-1], block_start[1:], strict=True)
    return np.array([np.count_nonzero(omega[low:high] <= STIFF_MODE) for low, high in blocks], dtype=np.int64)


@inlined
def factor_rates(plant, ws, N):
    """Overwrite the beam's part of rates N with their factors: v2, ω and the lift in place of its first η̇, s in that of π̇."""
    n, c, s, v = plant.modal.shape[1], ws.arm.trig[0], ws.arm.trig[1], ws.velocity
    lateral, turn, lift = c * v[1] - s * v[0], v[2], v[2] * (c * v[0] + s * v[1]) + plant.gravity * c
    for k in range(n):
        N[ETA + n + k] += plant.modal[H, k] * lift - plant.modal[DH, k] * lateral - plant.modal[DG, k] * turn
    N[ETA], N[ETA + 1], N[ETA + 2] = lateral, turn, lift


@disjoint
def add_two(a, column, b, other, on_eta, on_pi):
    """Add two columns (2k,) times two numbers to η and π (k,)."""
    k = len(on_eta)
    first, second, third, fourth = column[:k], column[k : 2 * k], other[:k], other[k : 2 * k]
    for i in range(k):
        on_eta[i] += a * first[i] + b * third[i]
    for i in range(k):
        on_pi[i] += a * second[i] + b * fourth[i]


@disjoint
def add_four(a, b, columns, c, d, others, on_eta, on_pi):
    """Add four columns (2k,) times four numbers to η and π (k,); `columns` and `others` hold two each.

    Elements are independent: the bits are the same however many of them a vector unit takes at once.
    """
    k = len(on_eta)
    a1, a2, b1, b2 = columns[:k], columns[k : 2 * k], columns[2 * k : 3 * k], columns[3 * k : 4 * k]
    c1, c2, d1, d2 = others[:k], others[k : 2 * k], others[2 * k : 3 * k], others[3 * k : 4 * k]
    for i in range(k):
        on_eta[i] += (a * a1[i] + b * b1[i]) + (c * c1[i] + d * d1[i])
    for i in range(k):
        on_pi[i] += (a * a2[i] + b * b2[i]) + (c * c2[i] + d * d2[i])


@inlined
def add_forced(starts, n, forced, soft, hand_pulls, z, out):
    """out += φ N in (η, π), (2 n_m,), for rates z that `factor_rates` has overwritten.

    `forced`: `forced_columns`, block after block. `soft`: `soft_modes`; a hand at the beam may move all modes.
    """
    at = 0
    for block in range(len(starts) - 1):
        low, k = starts[block], starts[block + 1] - starts[block]
        on_eta, on_pi, force = out[low : low + k], out[low + n : low + n + k], z[low + n : low + n + k]
        common, own = forced[at : at + 2 * COMMON * k], forced[at + 2 * COMMON * k : at + 2 * (COMMON + k) * k]
        add_two(z[0], common, z[1], common[2 * k :], on_eta, on_pi)
        moved = k if hand_pulls else soft[block]
        # The lift together with the first mode's force, so that the others can be added by fours.
        add_two(z[2], common[4 * k :], force[0], own, on_eta, on_pi)
        j = 1
        while j + 3 < moved:
            first, third = own[2 * k * j :], own[2 * k * (j + 2) :]
            add_four(force[j], force[j + 1], first, force[j + 2], force[j + 3], third, on_eta, on_pi)
            j += 4
        while j < moved:
            other = min(j + 1, moved - 1)
            add_two(force[j], own[2 * k * j :], force[other] if other > j else 0.0, own[2 * k * other :], on_eta, on_pi)
            j += 2
        at += 2 * (COMMON + k) * k


ROWS = 19
"""Rows of `Etdrk4.flow`. The first: η and η̇ at the step's end for b = 1, then for b = s, lateral and angular each."""
DAMPED, BEGUN, BEGUN_FORCE, MET, MET_FORCE, FAST = 8, 10, 12, 14, 16, 18
"""Further rows, two each: DΩ⁻²h and DΩ⁻²g; for fast modes only, η̇ at the step's end for the parabola of mean 0 that begins at
1 and ends at 0, and D times that; the same for the one that begins at 0 and ends at 1. Last: 1 for a fast mode, else 0."""
FAST_DAMPING = 3.0
"""Step times D of a mode from which on the flow gives a better η̇ than the integrator, although of lower order."""
TICKS = 2
"""Index behind η and π of the number of ticks since a start, a tap or a change set the state; NaN before the first."""
SAVED = 9
"""Row of `Workspace.stage` that keeps η, η̇ and f of a step's beginning; its last entries keep the grips' motion."""
START, MIDDLE = -6, -3
"""Index in that row of v2, ω and the part of b that is not a derivative, ω v1 + gravity cos θ, at these instants."""
BEGINNING, LINE = -8, -10
"""Index in that row of two values for the beginning of a tick's last step: b, NaN if unknown, and what the line gives for it."""


def flow_rows(
    omega: np.ndarray, damping: np.ndarray, loads: np.ndarray, phi: tuple[np.ndarray, ...], dt: float
) -> np.ndarray:
    """Columns of `Etdrk4.flow` (19, k) for one block with ω (k,), D (k, k), loads (2, k) and φ0 to φ3(hL) in (ωη, η̇)."""
    k = len(omega)
    rows = np.zeros((ROWS, k))
    _, phi1, phi2, phi3 = phi
    rows[FAST] = dt * damping.diagonal() > FAST_DAMPING
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


@inlined
def begin_flow(plant, y, ws):
    """Keep what the flow needs of a step's beginning, after `find_state`."""
    n = plant.modal.shape[1]
    kept, w = ws.stage[SAVED], ws.velocity[2]
    note_grips(plant, ws, START)
    lift = kept[START + 2]
    for k in range(n):
        kept[k], kept[n + k] = y[ETA + k], ws.eta_dot[k]
        kept[2 * n + k] = w * w * y[ETA + k] - plant.modal[H, k] * lift
    _note_axial_load(plant.axial, kept[2 * n : 3 * n], ws)


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
def _slope_with_axial(axial, k, slope, bent, per_step, ws):
    """The slope of mode k's load with that of the axial load, whose mode bends by `bent` in the step."""
    if axial is None:
        return slope
    if axial.shape[1] > 0:
        slope += (ws.axial_force[END, k] - ws.axial_force[BEFORE, k]) * per_step
        ws.axial_force[SCRATCH, k] = bent
    return slope


@inlined
def _loss_with_axial(axial, plant, loss, per_step, ws):
    """The loss of a step with what the axial load's slope adds."""
    if axial is None:
        return loss
    if axial.shape[1] > 0:
        block_product(plant.block_start, plant.damping, ws.axial_force[SCRATCH], ws.damping_force)
        for k in range(plant.modal.shape[1]):
            slope = (ws.axial_force[END, k] - ws.axial_force[BEFORE, k]) * per_step
            loss -= slope / plant.modal[OMEGA2, k] * ws.damping_force[k]
    return loss


@inlined
def end_flow(plant, flow, dt, free, y, ws):
    """Add the loss of the step that ends in y, and note η̇ and b of its end behind the state, after `find_state` of y.

    `free`: (η, π) at the step's end if the grips had kept their velocity.
    """
    n = plant.modal.shape[1]
    kept, rate, b = ws.stage[SAVED], y[ETA + 2 * n + 3 : ETA + 3 * n + 3], y[ETA + 2 * n : ETA + 2 * n + 2]
    if beam_is_held(plant):
        for k in range(n):
            rate[k] = np.nan
        return
    c, s, v = ws.arm.trig[0], ws.arm.trig[1], ws.velocity
    v2, w, lift = c * v[1] - s * v[0], v[2], v[2] * (c * v[0] + s * v[1]) + plant.gravity * c
    first, middle, lift_0 = kept[START], kept[MIDDLE], kept[START + 2]
    lateral = (v2 - first) / dt + (lift + 4 * kept[MIDDLE + 2] - 5 * lift_0) / 6
    lateral_slope = 4 * (first - 2 * middle + v2) / (dt * dt) + (lift - lift_0) / dt
    turn = (w - kept[START + 1]) / dt
    turn_slope = 4 * (kept[START + 1] - 2 * kept[MIDDLE + 1] + w) / (dt * dt)
    b[0], b[1] = lateral + dt / 2 * lateral_slope + kept[START + 2], turn + dt / 2 * turn_slope
    lateral, turn = lateral - dt / 2 * lateral_slope, turn - dt / 2 * turn_slope
    kept[LINE], kept[LINE + 1] = lateral + kept[START + 2], turn
    loss, per_step = 0.0, 1 / dt
    for k in range(n):
        h, g, stiffness = plant.modal[H, k], plant.modal[G, k], plant.modal[OMEGA2, k]
        eta = free[ETA + k] + lateral * flow[0, k] + lateral_slope * flow[2, k] + turn * flow[4, k]
        eta += turn_slope * flow[6, k]
        rate[k] = free[ETA + n + k] - h * first - g * kept[START + 1]
        rate[k] += lateral * flow[1, k] + lateral_slope * flow[3, k] + turn * flow[5, k] + turn_slope * flow[7, k]
        slope = h * lateral_slope + g * turn_slope
        slope = _slope_with_axial(plant.axial, k, slope, eta - kept[k], per_step, ws)
        u_0 = kept[k] - (kept[2 * n + k] - h * lateral - g * turn) / stiffness
        u_1 = eta - kept[k] + dt * slope / stiffness
        gain = rate[k] - kept[n + k]
        loss -= gain * (kept[n + k] + gain / 2) + stiffness * u_1 * (u_0 + u_1 / 2) + slope / stiffness * gain
        loss -= (lateral_slope * flow[DAMPED, k] + turn_slope * flow[DAMPED + 1, k]) * (eta - kept[k])
        if flow[FAST, k] == 0:
            rate[k] = ws.eta_dot[k]
    y[DISSIPATED] += _loss_with_axial(plant.axial, plant, loss, per_step, ws)


@inlined
def has_fast_modes(flow):
    """Whether any mode is damped faster than the step."""
    fast = 0.0
    for k in range(flow.shape[1]):
        fast += flow[FAST, k]
    return fast > 0


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
    """Correct the noted η̇ so that b ends at the present acceleration, after `end_flow`; u (arms, 3): inputs up to this instant.

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
