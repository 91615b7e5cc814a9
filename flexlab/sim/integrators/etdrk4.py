"""Exponential time differencing of order 4 (Krogstad, J. Comput. Phys. 203 (2005) 72-88, Eq. 51).

The beam's linear part d/dt (η, π) = (π, -Ω²η - Dπ) is propagated exactly, so that the motion and not the stiffest mode limits
the step. All other states have no linear part: the formulas, with φ_k(0) = 1/k!, become those of the classical Runge-Kutta
method. With L the linear part and N the rest:

    a = e^{hL/2} y + ½h φ1(½hL) N1
    b = a + h φ2(½hL) (N2 - N1)
    c = e^{hL} y + h φ1(hL) N1 + 2h φ2(hL) (N3 - N1)
    y⁺ = e^{hL} y + h φ1(hL) N1 + h φ2(hL) (-3N1 + 2N2 + 2N3 - N4) + 4h φ3(hL) (N1 - N2 - N3 + N4)

and e^{hL} y + h φ1(hL) N1 = e^{hL/2} a + ½h φ1(½hL) N1, which saves two matrix functions. If damping couples many modes, only
e^{hL/2} is a dense matrix; for the others see `forced_columns`.
"""

from collections.abc import Sequence

import numpy as np

from flexlab.compiled import disjoint, inlined
from flexlab.numerics.matrix_functions import Functions, doubled, phi_functions
from flexlab.physics.axial_load import END, NOW, START
from flexlab.physics.hand import beam_is_held
from flexlab.physics.plant import ETA, has_axial_load, joints_start, memory_start
from flexlab.sim.integrators.beam_flow import MIDDLE, begin_flow, flow_rows, note_grips
from flexlab.sim.integrators.forcing import (
    add_forced,
    add_four,
    add_two,
    factor_rates,
    forced_columns,
    is_factored,
    soft_modes,
)
from flexlab.sim.integrators.scheme import STATE, Etdrk4

HALF_PHI1, HALF_PHI2, PHI2, PHI3, HALF_EXP = range(5)
"""½h φ1(½hL), h φ2(½hL), h φ2(hL), h φ3(hL), e^{hL/2}: rows of `Etdrk4.operators`, or all but the last of `Etdrk4.forced`."""
FREE = 7
"""Row of `Workspace.stage` that holds e^{hL} y + h φ1(hL) N1 after a step: the beam with N constant."""
NEXT = np.uint64(1)
HALVINGS_KEPT = 8
"""Number of steps h, h/2, … whose matrix functions are kept: more than the levels after a disturbance."""


def block_functions(
    omega: np.ndarray, damping: np.ndarray, block_start: np.ndarray, dt: float
) -> list[list[Functions]]:
    """φ0 to φ3(hL) of each block of modes in (ωη, π) for h = dt, dt/2, …: at least two, at most `HALVINGS_KEPT`."""
    sizes, found = np.diff(block_start), [[]] * (len(block_start) - 1)
    for k in sorted(set(sizes.tolist())):
        alike = np.flatnonzero(sizes == k)
        own = block_start[alike][:, None] + np.arange(k)
        # In (ωη, π) the undamped part is skew: its powers keep their size and the doubling loses no digits.
        L, place = np.zeros((len(alike), 2 * k, 2 * k)), np.arange(k)
        L[:, place, k + place], L[:, k + place, place] = omega[own], -omega[own]
        L[:, k:, k:] = -damping[own[:, :, None], own[:, None]]
        halves = phi_functions(L * (dt / 2))[: HALVINGS_KEPT - 1]
        steps = [doubled(*halves[0]), *halves]
        for at, block in enumerate(alike.tolist()):
            found[block] = [tuple(function[at] for function in step) for step in steps]
    return found


def beam_operators(
    omega: np.ndarray,
    damping: np.ndarray,
    block_start: np.ndarray,
    loads: np.ndarray,
    dt: float,
    functions_at: Sequence[Sequence[Functions]],
) -> Etdrk4:
    """The matrix functions of the beam's linear part for step dt, and the constants of `beam_flow`.

    loads: Vᵀh and Vᵀg, (2, n_m); functions_at: for each block the `block_functions` of dt and dt/2.
    """
    whole, forced, flows, factored = [], [], [], is_factored(block_start)
    for low, high, (full, half) in zip(block_start[:-1], block_start[1:], functions_at, strict=True):
        own, D, load = omega[low:high], damping[low:high, low:high], loads[:, low:high]
        scale = np.concatenate([own, np.ones(high - low)])
        exp_half, phi1_half, phi2_half, _ = half
        of_rates = (dt / 2 * phi1_half, dt * phi2_half, dt * full[2], dt * full[3])
        exp_half, *of_rates = [F * scale / scale[:, None] for F in (exp_half, *of_rates)]
        if factored:
            forced.append(np.stack([forced_columns(F, D, load).ravel() for F in of_rates]))
        whole.append(np.stack([F.T.ravel() for F in ([] if factored else of_rates) + [exp_half]]))
        flows.append(flow_rows(own, D, load, full, dt))
    flow = np.concatenate(flows, axis=1) if np.any(damping) else np.zeros((len(flows[0]), 0))
    return Etdrk4(
        np.ascontiguousarray(np.concatenate(whole, axis=1)),
        np.ascontiguousarray(np.concatenate(forced, axis=1)) if factored else np.zeros((HALF_EXP, 0)),
        soft_modes(omega, block_start) if factored else np.zeros(0, np.int64),
        np.ascontiguousarray(flow),
    )


@disjoint
def add_pair(own, eta, pi, z, out):
    """`add_product` for one block of two modes, `own` (16,); eta and pi: indices of its first η and π."""
    # Unsigned indices are not tested for being negative, which took longer than the product.
    a, b, c, d = z[eta], z[eta + NEXT], z[pi], z[pi + NEXT]
    first = out[eta] + ((a * own[0] + b * own[4]) + (c * own[8] + d * own[12]))
    second = out[eta + NEXT] + ((a * own[1] + b * own[5]) + (c * own[9] + d * own[13]))
    third = out[pi] + ((a * own[2] + b * own[6]) + (c * own[10] + d * own[14]))
    fourth = out[pi + NEXT] + ((a * own[3] + b * own[7]) + (c * own[11] + d * own[15]))
    out[eta], out[eta + NEXT], out[pi], out[pi + NEXT] = first, second, third, fourth


@inlined
def add_product(block_start, n, operator, z, out):
    """out += operator z for z and out in (η, π), (2 n_m,), block by block; `operator` has all columns."""
    # Slices, not offsets: only for them does the compiler know that no index is negative, and use its vector units.
    if len(block_start) == n + 1:  # No modes are coupled.
        eta, pi, on_eta, on_pi = z[:n], z[n:], out[:n], out[n:]
        for k in range(n):
            on_eta[k] += operator[4 * k] * eta[k] + operator[4 * k + 2] * pi[k]
            on_pi[k] += operator[4 * k + 1] * eta[k] + operator[4 * k + 3] * pi[k]
        return
    at = 0
    for block in range(len(block_start) - 1):
        low, k = block_start[block], block_start[block + 1] - block_start[block]
        if k == 2:  # As with two elements: the same without the cost of loops.
            add_pair(operator[at : at + 16], np.uint64(low), np.uint64(low + n), z, out)
            at += 16
            continue
        eta, pi = z[low : low + k], z[low + n : low + n + k]
        on_eta, on_pi = out[low : low + k], out[low + n : low + n + k]
        of_eta, of_pi = operator[at : at + 2 * k * k], operator[at + 2 * k * k : at + 4 * k * k]
        for j in range(0, k - 1, 2):
            add_four(eta[j], eta[j + 1], of_eta[2 * k * j :], pi[j], pi[j + 1], of_pi[2 * k * j :], on_eta, on_pi)
        if k % 2 == 1:
            last = 2 * k * (k - 1)
            add_two(eta[k - 1], of_eta[last:], pi[k - 1], of_pi[last:], on_eta, on_pi)
        at += 4 * k * k


@disjoint
def classical_stage(stage, dt, N1, N2, N3, N4, z, y):
    """`next_stage` for states without a linear part: the classical Runge-Kutta formulas."""
    if stage == 0:
        for i in range(len(y)):
            z[i] = y[i] + dt / 2 * N1[i]
    elif stage == 1:
        for i in range(len(y)):
            z[i] = y[i] + dt / 2 * N2[i]
    elif stage == 2:
        for i in range(len(y)):
            z[i] = y[i] + dt * N3[i]
    else:
        for i in range(len(y)):
            y[i] += dt / 6 * (N1[i] + 2 * (N2[i] + N3[i]) + N4[i])


@inlined
def add_rates(plant, etdrk4, function, z, out):
    """out += a matrix function times rates z, or for HALF_EXP times (η, π); z and out: (2 n_m,)."""
    n = plant.modal.shape[1]
    if etdrk4.forced.shape[1] > 0 and function != HALF_EXP:
        add_forced(plant.block_start, n, etdrk4.forced[function], etdrk4.soft_modes, beam_is_held(plant), z, out)
    else:
        add_product(plant.block_start, n, etdrk4.operators[function if etdrk4.forced.shape[1] == 0 else 0], z, out)


@disjoint
def first_rise(N1, N2, a, d, z):
    """Prepare b: d = N2 - N1, z = a."""
    for i in range(len(z)):
        d[i] = N2[i] - N1[i]
        z[i] = a[i]


@disjoint
def second_rise(N1, N3, whole, d, z):
    """Prepare c: d = 2 (N3 - N1), z = e^{hL} y + h φ1(hL) N1."""
    for i in range(len(z)):
        d[i] = 2 * (N3[i] - N1[i])
        z[i] = whole[i]


@disjoint
def last_rise(N1, N2, N3, N4, whole, d, z, y):
    """Prepare y⁺: d and z are the factors of φ2(hL) and φ3(hL), y = e^{hL} y + h φ1(hL) N1."""
    for i in range(len(y)):
        y[i] = whole[i]
        d[i] = 2 * (N2[i] + N3[i]) - 3 * N1[i] - N4[i]
        z[i] = 4 * (N1[i] - N2[i] - N3[i] + N4[i])


@inlined
def next_stage(plant, etdrk4, stage, y, ws):
    """From N1..N(stage + 1) in ws.stage, fill the beam's next stage in ws.stage[STATE], or after the last one the new y.

    ws.stage[4] keeps a, ws.stage[FREE] e^{hL} y + h φ1(hL) N1. With `forced` functions, `factor_rates` overwrites the rates.
    """
    end = ETA + 2 * plant.modal.shape[1]
    if etdrk4.forced.shape[1] > 0:
        factor_rates(plant, ws, ws.stage[stage])
    N1, N2, N3, N4 = ws.stage[0, ETA:end], ws.stage[1, ETA:end], ws.stage[2, ETA:end], ws.stage[3, ETA:end]
    a, z, d, whole = ws.stage[4, ETA:end], ws.stage[STATE, ETA:end], ws.stage[6, ETA:end], ws.stage[FREE, ETA:end]
    beam = y[ETA:end]
    # All products are made in one place, as each is much machine code: choose function, source and target.
    count, function, source, target = 1, HALF_PHI1, d, z
    if stage == 0:
        count, source, target = 3, N1, whole
        for i in range(len(whole)):
            whole[i] = 0.0
    elif stage == 1:
        function = HALF_PHI2
        first_rise(N1, N2, a, d, z)
    elif stage == 2:
        function = PHI2
        second_rise(N1, N3, whole, d, z)
    else:
        count, function, target = 2, PHI2, beam
        last_rise(N1, N2, N3, N4, whole, d, z, beam)
    for product in range(count):
        if stage == 0 and product == 1:
            function, source, target = HALF_EXP, beam, a
            for i in range(len(a)):
                a[i] = whole[i]
        elif stage == 0 and product == 2:
            source, target = a, whole
        elif product == 1:
            function, source = PHI3, z
        add_rates(plant, etdrk4, function, source, target)
    if stage == 0:
        for i in range(len(z)):
            z[i] = a[i]


@inlined
def etdrk4_stage(system, etdrk4, stage, dt, y, ws):
    """`take_stage` of etdrk4, with the rates of stage k in ws.stage[k]; keeps what `beam_flow.end_flow` needs."""
    if stage == 0:
        begin_flow(system.plant, etdrk4.flow, y, ws)
    elif stage == 2:
        note_grips(system.plant, ws, MIDDLE)
    elif stage == 3:
        for i in range(len(ws.u)):
            for a in range(3):
                ws.u_before[i, a] = ws.u[i, a]
        for k in range(len(ws.eta_dot)):
            ws.axial_force[END, k] = ws.axial_force[NOW, k]
    rates, memory = ws.stage, memory_start(system.plant)
    for part in range(2):
        low, high = (0, ETA) if part == 0 else (joints_start(system.plant), memory + system.control.memory_size)
        N1, N2, N3, N4 = rates[0, low:high], rates[1, low:high], rates[2, low:high], rates[3, low:high]
        classical_stage(stage, dt, N1, N2, N3, N4, rates[STATE, low:high], y[low:high])
    next_stage(system.plant, etdrk4, stage, y, ws)


@inlined
def bend_flow(plant, etdrk4, ws):
    """Make the axial load's force in ws.stage[FREE] linear in time, instead of constant over the step."""
    if not has_axial_load(plant.axial):
        return
    n = plant.modal.shape[1]
    z = ws.stage[6, ETA : ETA + 2 * n]
    for k in range(n):
        z[k], z[n + k] = 0.0, ws.axial_force[START, k] - ws.axial_force[END, k]
    add_rates(plant, etdrk4, PHI2, z, ws.stage[FREE, ETA : ETA + 2 * n])
